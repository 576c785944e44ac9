/* SPDX-License-Identifier: Apache-2.0 */
/* A flat interface to the chip's hands, so that ctypes needs no copy of its structures. */
#include <string.h>

#include "hands.h"

/* start: accel xyz, gyro xyz. problem: at least 128 bytes. @return NULL with the problem. */
struct hands *shim_hands_open(const char *path, const double *start, char *problem)
{
	struct chip_motion motion;

	memcpy(motion.accel_mps2, start, sizeof(motion.accel_mps2));
	memcpy(motion.gyro_radps, start + 3, sizeof(motion.gyro_radps));
	return hands_open(path, &motion, problem, 128);
}

/* at: accel xyz, gyro xyz. @return NULL or the bad line. */
const char *shim_hands_at(struct hands *hands, double t_s, double *at)
{
	struct chip_motion motion;
	const char *bad = hands_at(hands, t_s, &motion);

	if (bad == NULL) {
		memcpy(at, motion.accel_mps2, sizeof(motion.accel_mps2));
		memcpy(at + 3, motion.gyro_radps, sizeof(motion.gyro_radps));
	}
	return bad;
}
