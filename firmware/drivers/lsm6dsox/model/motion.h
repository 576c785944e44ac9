/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Motion files for the chip model: what the sensor feels, over true time. Plain C11.
 *
 * Both forms hold rows of seven numbers: time in s; specific force in m/s^2, x y z; angular rate
 * in rad/s, x y z; all in the sensor's axes. Time rises strictly from row to row. Between rows the
 * motion is interpolated linearly, before the first and after the last row it stands still at it.
 *
 * Text (any name): the first line that does not start with '#' must be
 *
 *     t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps
 *
 * and each further one a row. Binary, little-endian: the eight characters "BVMOTION", version as
 * u32 (1), number of rows as u32, then the rows as seven f64 each.
 */
#ifndef BV_LSM6DSOX_MOTION_H_
#define BV_LSM6DSOX_MOTION_H_

#include <stddef.h>

#include "chip.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MOTION_COLUMNS 7

struct motion {
	size_t rows;
	double (*row)[MOTION_COLUMNS];
	/* Where the last look-up was: the next one is near. */
	size_t near;
};

/**
 * Read a motion file.
 *
 * @param[out] problem what is wrong with it, with the line or row, when NULL is returned.
 * @return the motion, to be freed with motion_free(), or NULL.
 */
struct motion *motion_load(const char *path, char *problem, size_t problem_size);

void motion_free(struct motion *motion);

/** The motion at @p t_s. */
void motion_at(struct motion *motion, double t_s, struct chip_motion *at);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_MOTION_H_ */
