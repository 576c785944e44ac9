/* SPDX-License-Identifier: Apache-2.0 */
/* The store on the simulated board's flash: what it keeps, and what it makes of what it finds. */
#include <string.h>

#include <zephyr/drivers/flash.h>
#include <zephyr/fs/nvs.h>
#include <zephyr/storage/flash_map.h>
#include <zephyr/ztest.h>

#include "calib_record.h"
#include "calib_store.h"

#define DEVICE_ID    UINT64_C(0xFEEDFACECAFEBEEF)
#define PAGE         4096U
#define PAGES        CONFIG_BV_CAL_STORE_SECTORS
#define AREA         FIXED_PARTITION_OFFSET(storage_partition)
#define RECORD_ID    1U
#define SAVES        200U
#define WRECKS       120U

static const struct device *const flash = FIXED_PARTITION_DEVICE(storage_partition);

static struct wire_cal_record record_of(uint32_t number)
{
	return (struct wire_cal_record){
		.device_id = DEVICE_ID,
		.created_unix_s = 1790000000U + number,
		.temperature_cdegc = 2345,
		.accel_bias_mps2 = {0.125f, -0.25f, 0.0625f},
		.accel_matrix = {1.0f, 0.015625f, 0.0f, 0.0f, 0.984375f, 0.0f, 0.0f, 0.0f, 1.03125f},
		.gyro_bias_radps = {0.015625f, -0.0078125f, 1e-6f * (float)number},
	};
}

static void expect_stored(const struct wire_cal_record *expected)
{
	struct wire_cal_record got;
	uint8_t one[WIRE_CAL_RECORD_SIZE];
	uint8_t other[WIRE_CAL_RECORD_SIZE];
	uint32_t crc32;
	uint8_t bytes[CALIB_RECORD_SIZE];

	zassert_equal(calib_store_load(&got, &crc32), WIRE_CAL_REASON_NONE);
	(void)wire_cal_record_put(one, expected);
	(void)wire_cal_record_put(other, &got);
	zassert_mem_equal(one, other, sizeof(one));
	zassert_equal(crc32, calib_record_encode(bytes, expected));
}

static void expect_reason(uint8_t reason)
{
	struct wire_cal_record got;
	uint32_t crc32;
	const uint8_t found = calib_store_load(&got, &crc32);

	zassert_equal(found, reason, "%u, expected %u", found, reason);
}

/* Write @p bytes as the record of a store in use, past the code under test. */
static void plant(const uint8_t *bytes, size_t len)
{
	struct nvs_fs nvs = {
		.flash_device = flash,
		.offset = AREA,
		.sector_size = PAGE,
		.sector_count = PAGES,
	};

	zassert_ok(calib_store_open(DEVICE_ID));
	zassert_ok(nvs_mount(&nvs));
	zassert_equal(nvs_write(&nvs, RECORD_ID, bytes, len), (ssize_t)len);
}

/* @return where in the first page the first record's bytes begin; PAGE when nowhere. */
static uint32_t place_of_record(void)
{
	for (uint32_t at = 0; at < PAGE; at += 4U) {
		uint32_t word;

		zassert_ok(flash_read(flash, AREA + at, &word, sizeof(word)));
		if ((word & 0xFFFFU) == CALIB_RECORD_MAGIC) {
			return at;
		}
	}
	return PAGE;
}

static uint32_t random_state;

/* xorshift32 (Marsaglia 2003): the same garbage in each run. */
static uint32_t random_u32(void)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 17;
	random_state ^= random_state << 5;
	return random_state;
}

static void write_garbage(uint32_t at, uint32_t len)
{
	for (uint32_t i = 0; i < len; i += 4U) {
		const uint32_t word = random_u32();

		zassert_ok(flash_write(flash, AREA + at + i, &word, sizeof(word)));
	}
}

static void before(void *unused)
{
	ARG_UNUSED(unused);
	random_state = 2463534242U;
	zassert_ok(flash_erase(flash, AREA, PAGES * PAGE));
}

ZTEST_SUITE(calib_store, NULL, NULL, before, NULL, NULL);

ZTEST(calib_store, test_an_empty_store_opens_and_holds_nothing)
{
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_reason(WIRE_CAL_REASON_ABSENT);
	zassert_ok(calib_store_erase());
}

ZTEST(calib_store, test_what_is_saved_is_there_after_a_restart)
{
	const struct wire_cal_record record = record_of(1);

	zassert_ok(calib_store_open(DEVICE_ID));
	zassert_ok(calib_store_save(&record));
	expect_stored(&record);
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_stored(&record);
}

ZTEST(calib_store, test_the_last_of_many_saves_counts)
{
	uint32_t used_pages = 0;

	zassert_ok(calib_store_open(DEVICE_ID));
	for (uint32_t i = 0; i < SAVES; i++) {
		const struct wire_cal_record record = record_of(i);

		zassert_ok(calib_store_save(&record), "%u", i);
		expect_stored(&record);
		if (i % 7U == 0U) {
			zassert_ok(calib_store_open(DEVICE_ID), "%u", i);
			expect_stored(&record);
		}
		for (uint32_t page = 0; page < PAGES; page++) {
			uint32_t word;

			zassert_ok(flash_read(flash, AREA + page * PAGE, &word, sizeof(word)));
			used_pages |= word != UINT32_MAX ? BIT(page) : 0U;
		}
	}
	zassert_equal(used_pages, BIT_MASK(PAGES), "the store did not go round");
}

ZTEST(calib_store, test_an_erased_record_is_absent_for_good)
{
	const struct wire_cal_record record = record_of(1);

	zassert_ok(calib_store_open(DEVICE_ID));
	zassert_ok(calib_store_save(&record));
	zassert_ok(calib_store_erase());
	expect_reason(WIRE_CAL_REASON_ABSENT);
	/* By an entry that says so: to clear pages would take longer, and could be cut short. */
	zassert_true(place_of_record() < PAGE);
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_reason(WIRE_CAL_REASON_ABSENT);
	zassert_ok(calib_store_save(&record));
	expect_stored(&record);
}

ZTEST(calib_store, test_another_nodes_record_is_not_used)
{
	const struct wire_cal_record record = record_of(1);

	zassert_ok(calib_store_open(DEVICE_ID));
	zassert_ok(calib_store_save(&record));
	zassert_ok(calib_store_open(DEVICE_ID + 1U));
	expect_reason(WIRE_CAL_REASON_OTHER_DEVICE);
}

ZTEST(calib_store, test_another_versions_record_is_not_used_and_can_be_replaced)
{
	/* CRC-32 of "CA", version 2, "a newer form", by zlib. */
	static const uint8_t newer[] = {0x43, 0x41, 2, 0, 'a', ' ', 'n', 'e', 'w', 'e', 'r', ' ',
					'f', 'o', 'r', 'm', 0xAB, 0x68, 0x2E, 0x1E};
	const struct wire_cal_record record = record_of(1);

	plant(newer, sizeof(newer));
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_reason(WIRE_CAL_REASON_VERSION);
	zassert_ok(calib_store_save(&record));
	expect_stored(&record);
}

ZTEST(calib_store, test_damaged_bytes_are_not_used_and_can_be_replaced)
{
	const struct wire_cal_record record = record_of(1);
	uint8_t bytes[CALIB_RECORD_SIZE];

	for (size_t at = 0; at < sizeof(bytes); at += 3U) {
		(void)calib_record_encode(bytes, &record);
		bytes[at] ^= 0x10U;
		plant(bytes, sizeof(bytes));
		zassert_ok(calib_store_open(DEVICE_ID));
		expect_reason(WIRE_CAL_REASON_CORRUPT);
	}
	plant(bytes, sizeof(bytes) - 1U);
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_reason(WIRE_CAL_REASON_CORRUPT);
	zassert_ok(calib_store_save(&record));
	expect_stored(&record);
}

ZTEST(calib_store, test_bits_that_fade_in_flash_are_noticed)
{
	const struct wire_cal_record record = record_of(1);
	uint32_t at;
	uint32_t word;

	zassert_ok(calib_store_open(DEVICE_ID));
	zassert_ok(calib_store_save(&record));
	at = place_of_record();
	zassert_ok(flash_read(flash, AREA + at + 20U, &word, sizeof(word)));
	/* One bit less. */
	word &= word - 1U;
	zassert_ok(flash_write(flash, AREA + at + 20U, &word, sizeof(word)));
	expect_reason(WIRE_CAL_REASON_CORRUPT);
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_reason(WIRE_CAL_REASON_CORRUPT);
}

ZTEST(calib_store, test_an_area_full_of_garbage_is_cleared_and_works)
{
	const struct wire_cal_record record = record_of(1);

	write_garbage(0, PAGES * PAGE);
	zassert_equal(calib_store_open(DEVICE_ID), -EILSEQ);
	expect_reason(WIRE_CAL_REASON_ABSENT);
	zassert_ok(calib_store_save(&record));
	zassert_ok(calib_store_open(DEVICE_ID));
	expect_stored(&record);
}

/* Garbage everywhere, and in it what was once a record of this node and two others. */
static void bury(const struct wire_cal_record *record)
{
	struct wire_cal_record older = *record;
	struct wire_cal_record foreign = *record;
	uint8_t bytes[ROUND_UP(CALIB_RECORD_SIZE, 4)] = {0};

	older.created_unix_s -= 1000U;
	foreign.device_id++;
	foreign.created_unix_s += 1000U;
	write_garbage(0, PAGE);
	(void)calib_record_encode(bytes, record);
	zassert_ok(flash_write(flash, AREA + PAGE, bytes, sizeof(bytes)));
	(void)calib_record_encode(bytes, &older);
	zassert_ok(flash_write(flash, AREA + PAGE + 400U, bytes, sizeof(bytes)));
	(void)calib_record_encode(bytes, &foreign);
	zassert_ok(flash_write(flash, AREA + PAGE + 800U, bytes, sizeof(bytes)));
	write_garbage(PAGE + 1000U, (PAGES - 1U) * PAGE - 1000U);
}

ZTEST(calib_store, test_a_record_in_a_damaged_store_is_used_and_never_cleared_but_on_demand)
{
	const struct wire_cal_record record = record_of(5);
	const struct wire_cal_record fresh = record_of(6);

	bury(&record);
	zassert_equal(calib_store_open(DEVICE_ID), -EIO);
	expect_stored(&record);
	zassert_equal(calib_store_save(&fresh), -EIO);
	zassert_equal(calib_store_open(DEVICE_ID), -EIO);
	expect_stored(&record);
	zassert_ok(calib_store_erase());
	expect_reason(WIRE_CAL_REASON_ABSENT);
	zassert_ok(calib_store_save(&fresh));
	expect_stored(&fresh);
}

ZTEST(calib_store, test_a_foreign_record_in_a_damaged_store_saves_nothing)
{
	const struct wire_cal_record record = record_of(5);

	bury(&record);
	zassert_equal(calib_store_open(DEVICE_ID + 2U), -EILSEQ);
	expect_reason(WIRE_CAL_REASON_ABSENT);
}

/* Some pages erased, some whole, some in pieces; closed, open, or with a torn end. */
static void make_wreck(void)
{
	zassert_ok(flash_erase(flash, AREA, PAGES * PAGE));
	for (uint32_t page = 0; page < PAGES; page++) {
		const uint32_t kind = random_u32() % 6U;
		const uint32_t begin = kind == 1U || kind == 2U ? 0U : 4U * (random_u32() % 1000U);
		const uint32_t end = kind == 2U ? PAGE : PAGE - 8U * (random_u32() % 4U);

		if (kind != 0U) {
			write_garbage(page * PAGE + begin, end - begin);
		}
	}
}

ZTEST(calib_store, test_no_wreck_costs_a_record)
{
	const struct wire_cal_record record = record_of(5);
	const struct wire_cal_record fresh = record_of(6);

	for (uint32_t i = 0; i < WRECKS; i++) {
		uint8_t bytes[ROUND_UP(CALIB_RECORD_SIZE, 4)] = {0};
		const uint32_t page = random_u32() % PAGES;

		make_wreck();
		zassert_ok(flash_erase(flash, AREA + page * PAGE, PAGE));
		write_garbage(page * PAGE, 1024U);
		(void)calib_record_encode(bytes, &record);
		zassert_ok(flash_write(flash, AREA + page * PAGE + 1024U, bytes, sizeof(bytes)));
		zassert_equal(calib_store_open(DEVICE_ID), -EIO, "%u", i);
		expect_stored(&record);
		zassert_equal(calib_store_save(&fresh), -EIO, "%u", i);
		zassert_equal(calib_store_open(DEVICE_ID), -EIO, "%u", i);
		expect_stored(&record);
	}
}

ZTEST(calib_store, test_no_wreck_stops_it)
{
	const struct wire_cal_record record = record_of(1);
	uint32_t cleared = 0;

	for (uint32_t i = 0; i < WRECKS; i++) {
		int err;

		make_wreck();
		err = calib_store_open(DEVICE_ID);
		zassert_true(err == 0 || err == -EILSEQ, "%u: %d", i, err);
		cleared += err != 0 ? 1U : 0U;
		zassert_ok(calib_store_save(&record), "%u", i);
		expect_stored(&record);
		zassert_ok(calib_store_open(DEVICE_ID), "%u", i);
		expect_stored(&record);
		zassert_ok(calib_store_erase(), "%u", i);
		expect_reason(WIRE_CAL_REASON_ABSENT);
	}
	zassert_true(cleared > WRECKS / 2U, "%u", cleared);
}
