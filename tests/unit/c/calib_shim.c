/* SPDX-License-Identifier: Apache-2.0 */
/* A flat interface to the target's calibration, so that ctypes needs no copy of its structures. */
#include <string.h>

#include "calib_boot.h"
#include "calib_correct.h"
#include "calib_record.h"

/* values: accel bias xyz, matrix row by row, gyro bias xyz. rows: gyro xyz, accel xyz; in place. */
void shim_correct(const float *values, uint8_t fs_g, uint16_t fs_dps, int16_t *rows, size_t count)
{
	struct calib_values v;
	struct calib_correct c;

	memcpy(v.accel_bias_mps2, values, sizeof(v.accel_bias_mps2));
	memcpy(v.accel_matrix, values + 3, sizeof(v.accel_matrix));
	memcpy(v.gyro_bias_radps, values + 12, sizeof(v.gyro_bias_radps));
	calib_correct_prepare(&c, &v, fs_g, fs_dps);
	for (size_t i = 0; i < count; i++) {
		calib_correct_gyro(&c, rows + 6 * i, rows + 6 * i);
		calib_correct_accel(&c, rows + 6 * i + 3, rows + 6 * i + 3);
	}
}

/*
 * Rows of gyro xyz [rad/s], accel xyz [m/s^2] through a boot check that starts anew.
 *
 * events: one of enum calib_boot_event for each row. bias: that of the last still window.
 * restart_at: the check is restarted before this row.
 */
uint32_t shim_boot(const uint64_t *t_ticks, const float *rows, size_t count, size_t restart_at,
		   int *events, float *bias)
{
	struct calib_boot boot;

	memset(&boot, 0, sizeof(boot));
	for (size_t i = 0; i < count; i++) {
		if (i == restart_at) {
			calib_boot_restart(&boot);
		}
		events[i] = (int)calib_boot_push(&boot, t_ticks[i], rows + 6 * i, rows + 6 * i + 3);
	}
	memcpy(bias, boot.gyro_bias_radps, sizeof(boot.gyro_bias_radps));
	return boot.attempts;
}

int shim_decide(const float *measured, const float *stored, float *delta_dps)
{
	return calib_boot_decide(measured, stored, delta_dps);
}

/* numbers: accel bias xyz, matrix, gyro bias xyz. @return CRC-32. */
uint32_t shim_encode(uint8_t *bytes, uint64_t device_id, uint32_t created_unix_s,
		     int16_t temperature_cdegc, const float *numbers)
{
	struct wire_cal_record r = {.device_id = device_id,
				    .created_unix_s = created_unix_s,
				    .temperature_cdegc = temperature_cdegc};

	memcpy(r.accel_bias_mps2, numbers, sizeof(r.accel_bias_mps2));
	memcpy(r.accel_matrix, numbers + 3, sizeof(r.accel_matrix));
	memcpy(r.gyro_bias_radps, numbers + 12, sizeof(r.gyro_bias_radps));
	return calib_record_encode(bytes, &r);
}

/* @return WIRE_CAL_REASON_... */
int shim_decode(const uint8_t *bytes, size_t len, uint64_t device_id, uint32_t *crc32,
		float *numbers)
{
	struct wire_cal_record r;
	const int reason = calib_record_decode(&r, crc32, bytes, len, device_id);

	if (reason == WIRE_CAL_REASON_NONE) {
		memcpy(numbers, r.accel_bias_mps2, sizeof(r.accel_bias_mps2));
		memcpy(numbers + 3, r.accel_matrix, sizeof(r.accel_matrix));
		memcpy(numbers + 12, r.gyro_bias_radps, sizeof(r.gyro_bias_radps));
	}
	return reason;
}
