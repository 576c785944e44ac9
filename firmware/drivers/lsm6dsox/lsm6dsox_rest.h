/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * When a sensor has been at rest for long enough to sleep. Pure C11; counts samples, not time.
 *
 * A sample is calm when no axis of the angular rate exceeds a threshold and no axis of the specific
 * force is further than a threshold from where it was when the calm began. So gravity needs no
 * estimate and a slow tilt ends the calm.
 */
#ifndef BV_LSM6DSOX_REST_H_
#define BV_LSM6DSOX_REST_H_

#include <stdbool.h>
#include <stdint.h>

#include "lsm6dsox_decoder.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lsm6dsox_rest {
	/** Thresholds in counts. */
	int32_t gyro_lsb;
	int32_t accel_lsb;
	/** Calm samples that make a rest; 0 switches the detector off. */
	uint32_t needed;
	/** Calm samples so far. */
	uint32_t calm;
	int16_t reference_lsb[3];
};

void lsm6dsox_rest_reset(struct lsm6dsox_rest *rest);

/** Look at one sample. @return whether the rest has lasted long enough. */
bool lsm6dsox_rest_push(struct lsm6dsox_rest *rest, const struct lsm6dsox_pair *pair);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_REST_H_ */
