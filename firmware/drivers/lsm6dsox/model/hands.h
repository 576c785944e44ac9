/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Somebody who holds the chip while the simulation runs. Plain C11 and POSIX.
 *
 * The file is a named pipe. Whoever writes to it moves the chip by lines of seven numbers, as a
 * row of a motion file but with a duration first:
 *
 *     dt_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps
 *
 * The motion goes linearly from what it was to these values within dt_s of simulated time, which
 * begins when the line before has been carried out, or at once. Then it stays.
 */
#ifndef BV_LSM6DSOX_HANDS_H_
#define BV_LSM6DSOX_HANDS_H_

#include <stddef.h>

#include "chip.h"

#ifdef __cplusplus
extern "C" {
#endif

struct hands;

/**
 * Open the pipe at @p path; the chip is at rest in @p start until the first line.
 *
 * @param[out] problem what is wrong, when NULL is returned.
 */
struct hands *hands_open(const char *path, const struct chip_motion *start, char *problem,
			 size_t problem_size);

void hands_close(struct hands *hands);

/**
 * The motion at @p t_s, which never goes back. Reads what has been written since.
 *
 * @return NULL, or a line that is not as it must be; it is valid until the next call.
 */
const char *hands_at(struct hands *hands, double t_s, struct chip_motion *at);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_HANDS_H_ */
