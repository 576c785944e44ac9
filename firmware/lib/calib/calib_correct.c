/* SPDX-License-Identifier: Apache-2.0 */
#include "calib_correct.h"

#include <math.h>
#include <string.h>

#include "lsm6dsox_scale.h"

float calib_accel_mps2_per_lsb(uint8_t fs_g)
{
	return (float)(fs_g * LSM6DSOX_ACCEL_MPS2_PER_LSB_PER_G);
}

float calib_gyro_radps_per_lsb(uint16_t fs_dps)
{
	return (float)(fs_dps * LSM6DSOX_GYRO_RADPS_PER_LSB_PER_DPS);
}

void calib_correct_prepare(struct calib_correct *correct, const struct calib_values *values,
			   uint8_t accel_fs_g, uint16_t gyro_fs_dps)
{
	const float mps2_per_lsb = calib_accel_mps2_per_lsb(accel_fs_g);
	const float radps_per_lsb = calib_gyro_radps_per_lsb(gyro_fs_dps);

	for (int j = 0; j < 3; j++) {
		correct->accel_bias_lsb[j] = values->accel_bias_mps2[j] / mps2_per_lsb;
		correct->gyro_bias_lsb[j] = values->gyro_bias_radps[j] / radps_per_lsb;
	}
	memcpy(correct->accel_matrix, values->accel_matrix, sizeof(correct->accel_matrix));
}

static int16_t to_count(int16_t raw, float corrected)
{
	const float limit = (float)CALIB_COUNT_MAX;

	/* What may be clipped is passed on as it is, so that it shows. */
	if (raw >= LSM6DSOX_CLIPPED_LSB || raw <= -LSM6DSOX_CLIPPED_LSB) {
		return raw;
	}
	/* The limits are whole numbers: clamped first, it rounds to the same. */
	corrected = corrected > limit ? limit : corrected < -limit ? -limit : corrected;
	return (int16_t)rintf(corrected);
}

void calib_correct_accel(const struct calib_correct *correct, const int16_t raw[3], int16_t out[3])
{
	const float *m = correct->accel_matrix;
	const int16_t in[3] = {raw[0], raw[1], raw[2]};
	float c[3];

	for (int j = 0; j < 3; j++) {
		c[j] = (float)in[j] - correct->accel_bias_lsb[j];
	}
	for (int i = 0; i < 3; i++, m += 3) {
		out[i] = to_count(in[i], (m[0] * c[0] + m[1] * c[1]) + m[2] * c[2]);
	}
}

void calib_correct_gyro(const struct calib_correct *correct, const int16_t raw[3], int16_t out[3])
{
	for (int j = 0; j < 3; j++) {
		out[j] = to_count(raw[j], (float)raw[j] - correct->gyro_bias_lsb[j]);
	}
}
