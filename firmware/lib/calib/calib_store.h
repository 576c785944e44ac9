/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The one calibration record in flash, through Zephyr's NVS.
 *
 * NVS appends: a record is in force only when its entry, written after its data, is whole. So a
 * power cut at any instant leaves the old record or the new one; the record's own CRC is the second
 * guard. The area is cleared only when no record of this node can be found anywhere in it, or to
 * erase what is stored.
 *
 * Not reentrant: from one thread at a time. Writes stall the CPU for 85 ms when a page is erased
 * (nRF52840 PS v1.7, section 4.3), once in some 44 of them.
 */
#ifndef BV_CALIB_STORE_H_
#define BV_CALIB_STORE_H_

#include <errno.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CALIB_STORE_KEY_SIZE 16U

#if defined(CONFIG_BV_CAL_STORE)

/**
 * Make the store of the node @p device_id usable. An area that is no store, and in which no record
 * of this node is found, is cleared.
 *
 * @return 0; -EILSEQ when what was in it had to be cleared; -EIO when it is
 *         damaged but holds a record, which calib_store_load() finds: it can be read and erased,
 *         not written; or a negative errno of the flash.
 */
int calib_store_open(uint64_t device_id);

/**
 * Read the record.
 *
 * @param[out] record, crc32 valid only when WIRE_CAL_REASON_NONE is returned.
 * @return WIRE_CAL_REASON_...; _FLASH when the store cannot be read.
 */
uint8_t calib_store_load(struct wire_cal_record *record, uint32_t *crc32);

/**
 * Write @p record, read it back and compare.
 *
 * @return 0; -EIO when the store does not hold it, and then it may hold the one before; or a
 *         negative errno of the flash.
 */
int calib_store_save(const struct wire_cal_record *record);

/** Read the link's key, 16 bytes. @return 0; -ENOENT when there is none; -EIO. */
int calib_store_get_key(uint8_t key[CALIB_STORE_KEY_SIZE]);

/** Write the link's key, NULL: forget it. @return 0, or a negative errno of the flash. */
int calib_store_put_key(const uint8_t key[CALIB_STORE_KEY_SIZE]);

/** Forget the record. @return 0, or a negative errno when it is still there. */
int calib_store_erase(void);

#else

static inline int calib_store_open(uint64_t device_id)
{
	(void)device_id;
	return 0;
}

static inline uint8_t calib_store_load(struct wire_cal_record *record, uint32_t *crc32)
{
	(void)record;
	(void)crc32;
	return WIRE_CAL_REASON_ABSENT;
}

static inline int calib_store_save(const struct wire_cal_record *record)
{
	(void)record;
	return -ENOTSUP;
}

static inline int calib_store_get_key(uint8_t key[CALIB_STORE_KEY_SIZE])
{
	(void)key;
	return -ENOTSUP;
}

static inline int calib_store_put_key(const uint8_t key[CALIB_STORE_KEY_SIZE])
{
	(void)key;
	return -ENOTSUP;
}

static inline int calib_store_erase(void)
{
	return 0;
}

#endif

#ifdef __cplusplus
}
#endif

#endif /* BV_CALIB_STORE_H_ */
