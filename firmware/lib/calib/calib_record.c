/* SPDX-License-Identifier: Apache-2.0 */
#include "calib_record.h"

#include <math.h>
#include <stdbool.h>

/* CRC-32 (IEEE 802.3), reflected. Bit by bit: a record is read once and written seldom. */
static uint32_t crc32_of(const uint8_t *bytes, size_t len)
{
	uint32_t crc = 0xFFFFFFFFU;

	for (size_t i = 0; i < len; i++) {
		crc ^= bytes[i];
		for (int bit = 0; bit < 8; bit++) {
			crc = (crc >> 1) ^ ((crc & 1U) != 0U ? 0xEDB88320U : 0U);
		}
	}
	return ~crc;
}

/* The comparisons are false for what is no number, too. */
static bool is_within(const float v[3], float norm_max)
{
	return (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2] <= norm_max * norm_max;
}

static bool is_near_identity(const float m[9])
{
	for (int i = 0; i < 9; i++) {
		const float identity = i % 4 == 0 ? 1.0f : 0.0f;

		if (!(fabsf(m[i] - identity) <= CALIB_MATRIX_OFF_MAX)) {
			return false;
		}
	}
	return true;
}

uint8_t calib_record_check(const struct wire_cal_record *record, uint64_t device_id)
{
	if (!is_within(record->accel_bias_mps2, CALIB_ACCEL_BIAS_MAX_MPS2) ||
	    !is_near_identity(record->accel_matrix) ||
	    !is_within(record->gyro_bias_radps, CALIB_GYRO_BIAS_MAX_RADPS)) {
		return WIRE_CAL_REASON_CORRUPT;
	}
	return record->device_id == device_id ? WIRE_CAL_REASON_NONE : WIRE_CAL_REASON_OTHER_DEVICE;
}

uint32_t calib_record_encode(uint8_t *bytes, const struct wire_cal_record *record)
{
	const size_t covered = CALIB_RECORD_SIZE - CALIB_RECORD_CRC_SIZE;
	uint32_t crc32;

	wire_put_u16(bytes, CALIB_RECORD_MAGIC);
	wire_put_u16(bytes + 2, CALIB_RECORD_VERSION);
	(void)wire_cal_record_put(bytes + CALIB_RECORD_HEADER_SIZE, record);
	crc32 = crc32_of(bytes, covered);
	wire_put_u32(bytes + covered, crc32);
	return crc32;
}

uint8_t calib_record_decode(struct wire_cal_record *record, uint32_t *crc32, const uint8_t *bytes,
			    size_t len, uint64_t device_id)
{
	size_t covered;

	if (len == 0U) {
		return WIRE_CAL_REASON_ABSENT;
	}
	if (len < CALIB_RECORD_HEADER_SIZE + CALIB_RECORD_CRC_SIZE ||
	    wire_get_u16(bytes) != CALIB_RECORD_MAGIC) {
		return WIRE_CAL_REASON_CORRUPT;
	}
	/* Before the version: a flipped bit must not pass for a newer firmware's record. */
	covered = len - CALIB_RECORD_CRC_SIZE;
	*crc32 = wire_get_u32(bytes + covered);
	if (*crc32 != crc32_of(bytes, covered)) {
		return WIRE_CAL_REASON_CORRUPT;
	}
	if (wire_get_u16(bytes + 2) != CALIB_RECORD_VERSION) {
		return WIRE_CAL_REASON_VERSION;
	}
	if (!wire_cal_record_get(record, bytes + CALIB_RECORD_HEADER_SIZE,
				 covered - CALIB_RECORD_HEADER_SIZE)) {
		return WIRE_CAL_REASON_CORRUPT;
	}
	return calib_record_check(record, device_id);
}
