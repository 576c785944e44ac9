/* SPDX-License-Identifier: Apache-2.0 */
#include "calib_store.h"

#include <stdbool.h>
#include <string.h>

#include <zephyr/device.h>
#include <zephyr/drivers/flash.h>
#include <zephyr/fs/nvs.h>
#include <zephyr/kernel.h>
#include <zephyr/storage/flash_map.h>

#include "calib_record.h"

#define RECORD_ID 1U
#define MARK_ID   2U
#define KEY_ID    3U

#define SECTOR_SIZE 4096U
#define AREA_OFFSET FIXED_PARTITION_OFFSET(storage_partition)
#define AREA_SIZE   (CONFIG_BV_CAL_STORE_SECTORS * SECTOR_SIZE)

/* Records begin where NVS can write: at multiples of the flash's word. */
#define FLASH_WORD 4U

/* Words in a new store that a first start or two, cut short, may have written. */
#define BLANK_WORDS_MAX 16U

BUILD_ASSERT(AREA_SIZE <= FIXED_PARTITION_SIZE(storage_partition));

static struct nvs_fs nvs = {
	.flash_device = FIXED_PARTITION_DEVICE(storage_partition),
	.offset = AREA_OFFSET,
	.sector_size = SECTOR_SIZE,
	.sector_count = CONFIG_BV_CAL_STORE_SECTORS,
};

/* That this is a store at all. NVS takes garbage with an erased page in it for its own, erases
 * pages at once, and finds nothing of what it wrote after the next start.
 */
static const uint8_t mark[4] = {'B', 'V', 'C', 'S'};

static bool mounted;
static uint64_t device_id;

static bool is_marked(void)
{
	uint8_t found[sizeof(mark)];

	return nvs_read(&nvs, MARK_ID, found, sizeof(found)) == (ssize_t)sizeof(found) &&
	       memcmp(found, mark, sizeof(mark)) == 0;
}

static int mount_and_mark(void)
{
	int err = nvs_mount(&nvs);

	if (!err) {
		const ssize_t len = nvs_write(&nvs, MARK_ID, mark, sizeof(mark));

		err = len < 0 ? (int)len : is_marked() ? 0 : -EIO;
	}
	mounted = err == 0;
	return err;
}

static int clear(void)
{
	int err;

	mounted = false;
	err = flash_erase(nvs.flash_device, AREA_OFFSET, AREA_SIZE);
	return err ? err : mount_and_mark();
}

static uint32_t word_at(uint32_t at)
{
	uint32_t word = 0;

	(void)flash_read(nvs.flash_device, (off_t)(AREA_OFFSET + at), &word, sizeof(word));
	return word;
}

static bool is_blank(void)
{
	uint32_t written = 0;

	for (uint32_t at = 0; at < AREA_SIZE && written <= BLANK_WORDS_MAX; at += FLASH_WORD) {
		written += word_at(at) != UINT32_MAX ? 1U : 0U;
	}
	return written <= BLANK_WORDS_MAX;
}

/* Whether the mark is anywhere, so that NVS may have a look. */
static bool may_be_store(void)
{
	uint32_t mark_word;

	memcpy(&mark_word, mark, sizeof(mark_word));
	for (uint32_t at = 0; at < AREA_SIZE; at += FLASH_WORD) {
		if (word_at(at) == mark_word) {
			return true;
		}
	}
	return false;
}

/*
 * A record of this node anywhere in the area, whatever NVS makes of it; of several the one that was
 * measured last.
 */
static bool find(struct wire_cal_record *record, uint32_t *crc32)
{
	bool found = false;

	for (uint32_t at = 0; at + CALIB_RECORD_SIZE <= AREA_SIZE; at += FLASH_WORD) {
		struct wire_cal_record one;
		uint8_t bytes[CALIB_RECORD_SIZE];
		uint32_t crc;

		if (flash_read(nvs.flash_device, (off_t)(AREA_OFFSET + at), bytes,
			       CALIB_RECORD_HEADER_SIZE) != 0 ||
		    wire_get_u16(bytes) != CALIB_RECORD_MAGIC ||
		    flash_read(nvs.flash_device, (off_t)(AREA_OFFSET + at), bytes, sizeof(bytes)) != 0 ||
		    calib_record_decode(&one, &crc, bytes, sizeof(bytes), device_id) !=
			    WIRE_CAL_REASON_NONE) {
			continue;
		}
		if (!found || one.created_unix_s >= record->created_unix_s) {
			*record = one;
			*crc32 = crc;
			found = true;
		}
	}
	return found;
}

static bool holds_any(void)
{
	struct wire_cal_record record;
	uint32_t crc32;

	return find(&record, &crc32);
}

int calib_store_open(uint64_t id)
{
	device_id = id;
	mounted = false;
	if (!device_is_ready(nvs.flash_device)) {
		return -ENODEV;
	}
	if (is_blank()) {
		return mount_and_mark();
	}
	mounted = may_be_store() && nvs_mount(&nvs) == 0 && is_marked();
	if (mounted) {
		return 0;
	}
	if (holds_any()) {
		return -EIO;
	}
	return clear() == 0 ? -EILSEQ : -EIO;
}

uint8_t calib_store_load(struct wire_cal_record *record, uint32_t *crc32)
{
	/* Longer than a record, so that one of another version is read as a whole. */
	uint8_t bytes[2U * CALIB_RECORD_SIZE];
	ssize_t len;

	if (!mounted) {
		return find(record, crc32) ? WIRE_CAL_REASON_NONE : WIRE_CAL_REASON_FLASH;
	}
	len = nvs_read(&nvs, RECORD_ID, bytes, sizeof(bytes));
	if (len == -ENOENT) {
		return WIRE_CAL_REASON_ABSENT;
	}
	if (len < 0) {
		return WIRE_CAL_REASON_FLASH;
	}
	return calib_record_decode(record, crc32, bytes, MIN((size_t)len, sizeof(bytes)), device_id);
}

static int write_and_compare(const uint8_t bytes[CALIB_RECORD_SIZE])
{
	uint8_t back[CALIB_RECORD_SIZE];
	ssize_t len = nvs_write(&nvs, RECORD_ID, bytes, CALIB_RECORD_SIZE);

	if (len < 0) {
		return (int)len;
	}
	len = nvs_read(&nvs, RECORD_ID, back, sizeof(back));
	return len == (ssize_t)sizeof(back) && memcmp(back, bytes, sizeof(back)) == 0 ? 0 : -EIO;
}

int calib_store_save(const struct wire_cal_record *record)
{
	uint8_t bytes[CALIB_RECORD_SIZE];
	int err = -EIO;

	(void)calib_record_encode(bytes, record);
	if (mounted) {
		err = write_and_compare(bytes);
	}
	if (err && !holds_any()) {
		err = clear();
		if (!err) {
			err = write_and_compare(bytes);
		}
	}
	return err;
}

int calib_store_get_key(uint8_t key[CALIB_STORE_KEY_SIZE])
{
	/* A cleared store has none, one that holds a damaged page may have had one. */
	const ssize_t len = mounted ? nvs_read(&nvs, KEY_ID, key, CALIB_STORE_KEY_SIZE) : -EIO;

	if (len == -ENOENT) {
		return -ENOENT;
	}
	return len == (ssize_t)CALIB_STORE_KEY_SIZE ? 0 : -EIO;
}

int calib_store_put_key(const uint8_t key[CALIB_STORE_KEY_SIZE])
{
	uint8_t back[CALIB_STORE_KEY_SIZE];
	ssize_t len;

	if (!mounted) {
		return -EIO;
	}
	if (key == NULL) {
		return nvs_delete(&nvs, KEY_ID);
	}
	len = nvs_write(&nvs, KEY_ID, key, CALIB_STORE_KEY_SIZE);
	if (len < 0) {
		return (int)len;
	}
	return calib_store_get_key(back) == 0 && memcmp(back, key, sizeof(back)) == 0 ? 0 : -EIO;
}

int calib_store_erase(void)
{
	uint8_t byte;

	if (mounted && nvs_delete(&nvs, RECORD_ID) == 0 &&
	    nvs_read(&nvs, RECORD_ID, &byte, sizeof(byte)) == -ENOENT) {
		return 0;
	}
	return clear();
}
