/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What a count of the LSM6DSOX stands for, nominally, and where its range ends. Constants only, C11
 * and C++.
 *
 * Datasheet DS12814, table 2: 30.5 ug and 35 udps a count, per unit of full scale.
 */
#ifndef BV_LSM6DSOX_SCALE_H_
#define BV_LSM6DSOX_SCALE_H_

/** Acceleration of one count, m/s^2, per g of full scale; standard gravity. */
#define LSM6DSOX_ACCEL_MPS2_PER_LSB_PER_G (3.05e-5 * 9.80665)
/** Rate of one count, rad/s, per dps of full scale. */
#define LSM6DSOX_GYRO_RADPS_PER_LSB_PER_DPS (3.5e-5 * (3.14159265358979323846 / 180.0))

/** The same in whole numbers: ug and udps, twice the first because it is 30.5. */
#define LSM6DSOX_ACCEL_UG_PER_2_LSB_PER_G  61
#define LSM6DSOX_GYRO_UDPS_PER_LSB_PER_DPS 35
/** And as whole numbers in SI: 1e-12 m/s^2 (exact) and 1e-15 rad/s (rounded). */
#define LSM6DSOX_ACCEL_PMPS2_PER_LSB_PER_G   299102825
#define LSM6DSOX_GYRO_FRADPS_PER_LSB_PER_DPS 610865238

/**
 * From here on, by amount, a count may be the end of the range: a saturated axis rests a little
 * below the end of the 16 bits, at 32742 in one of ST's own logs.
 */
#define LSM6DSOX_CLIPPED_LSB 32700

#endif /* BV_LSM6DSOX_SCALE_H_ */
