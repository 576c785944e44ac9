/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * A calibration as it is stored: bytes, and whether to believe them. Pure C11.
 *
 *   magic u16 | version u16 | payload of the wire message cal_record | CRC-32 (IEEE) of all before
 *
 * little-endian, as everything on the wire.
 */
#ifndef BV_CALIB_RECORD_H_
#define BV_CALIB_RECORD_H_

#include <stddef.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** "CA" in a hex dump. */
#define CALIB_RECORD_MAGIC   0x4143U
#define CALIB_RECORD_VERSION 1U

#define CALIB_RECORD_HEADER_SIZE 4U
#define CALIB_RECORD_CRC_SIZE    4U
#define CALIB_RECORD_SIZE                                                                          \
	(CALIB_RECORD_HEADER_SIZE + WIRE_CAL_RECORD_SIZE + CALIB_RECORD_CRC_SIZE)

/** What no LSM6DSOX needs: its offsets are within 20 mg and 1 dps, its scale within 1 %. */
#define CALIB_ACCEL_BIAS_MAX_MPS2 2.0f
#define CALIB_MATRIX_OFF_MAX      0.1f
#define CALIB_GYRO_BIAS_MAX_RADPS 0.35f

/**
 * @return WIRE_CAL_REASON_NONE; _CORRUPT when a number is not finite or impossible;
 *         _OTHER_DEVICE when it was measured on another node than @p device_id.
 */
uint8_t calib_record_check(const struct wire_cal_record *record, uint64_t device_id);

/** Write the stored form, CALIB_RECORD_SIZE bytes. @return its CRC-32. */
uint32_t calib_record_encode(uint8_t *bytes, const struct wire_cal_record *record);

/**
 * Read the stored form of a record of the node @p device_id.
 *
 * @param[out] record valid only when WIRE_CAL_REASON_NONE is returned; so @p crc32.
 * @return WIRE_CAL_REASON_...: _ABSENT for no bytes at all, _VERSION for whole bytes of another
 *         version, _CORRUPT for bytes that are damaged; or as calib_record_check().
 */
uint8_t calib_record_decode(struct wire_cal_record *record, uint32_t *crc32, const uint8_t *bytes,
			    size_t len, uint64_t device_id);

#ifdef __cplusplus
}
#endif

#endif /* BV_CALIB_RECORD_H_ */
