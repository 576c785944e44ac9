/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Counts of the sensor, corrected in counts. Pure C11, no clock, no state but what is passed in.
 *
 * Accelerometer a = M (raw - b), gyroscope w = raw - b, rounded half to even and clamped. Every
 * operation is one IEEE 754 single, in the order written here and without contraction, so that a
 * host repeats it bit for bit. Identity and zero give the counts back as they came.
 *
 * A count is small against the noise of one sample (0.5 mg and 70 mdps at the widest scales,
 * 110 ug/rtHz and 3.8 mdps/rtHz of noise), and the noise dithers the rounding.
 */
#ifndef BV_CALIB_CORRECT_H_
#define BV_CALIB_CORRECT_H_

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Largest magnitude of a corrected count. */
#define CALIB_COUNT_MAX   32767

/** A calibration in SI units. */
struct calib_values {
	/** b in a = M (raw - b). */
	float accel_bias_mps2[3];
	/** M, row by row. */
	float accel_matrix[9];
	/** Subtracted from the raw rate. */
	float gyro_bias_radps[3];
};

/** A calibration in counts of one pair of full scales. */
struct calib_correct {
	float accel_bias_lsb[3];
	float accel_matrix[9];
	float gyro_bias_lsb[3];
};

/** Acceleration of one count [m/s^2] at a full scale of @p fs_g (2, 4, 8, 16). */
float calib_accel_mps2_per_lsb(uint8_t fs_g);

/** Rate of one count [rad/s] at a full scale of @p fs_dps (125, 250, 500, 1000, 2000). */
float calib_gyro_radps_per_lsb(uint16_t fs_dps);

/** @p values, which are finite, for counts of these full scales. */
void calib_correct_prepare(struct calib_correct *correct, const struct calib_values *values,
			   uint8_t accel_fs_g, uint16_t gyro_fs_dps);

/** @p raw and @p out may be the same. */
void calib_correct_accel(const struct calib_correct *correct, const int16_t raw[3], int16_t out[3]);

/** @p raw and @p out may be the same. */
void calib_correct_gyro(const struct calib_correct *correct, const int16_t raw[3], int16_t out[3]);

#ifdef __cplusplus
}
#endif

#endif /* BV_CALIB_CORRECT_H_ */
