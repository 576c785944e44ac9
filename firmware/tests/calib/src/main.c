/* SPDX-License-Identifier: Apache-2.0 */
/* The calibration as a node runs it: batches through the boot check, commands, restarts. */
#include <errno.h>
#include <string.h>

#include <zephyr/drivers/flash.h>
#include <zephyr/storage/flash_map.h>
#include <zephyr/ztest.h>

#include "calib.h"
#include "calib_boot.h"
#include "line.h"

#define DEVICE_ID    UINT64_C(0xFEEDFACECAFEBEEF)
#define TICKS_PER_S  16000000U
#define RATE_HZ      100U
#define BATCH        8U
#define PERIOD_TICKS (TICKS_PER_S / RATE_HZ)
#define AREA         FIXED_PARTITION_OFFSET(storage_partition)
#define AREA_SIZE    (CONFIG_BV_CAL_STORE_SECTORS * 4096U)

/* 1000 dps: 35 mdps a count. 4 g: 0.122 mg a count. */
#define FS_DPS       1000U
#define FS_G         4U
#define RADPS_PER_DPS 0.017453292519943295

static const struct device *const flash = FIXED_PARTITION_DEVICE(storage_partition);

/* What the sensor says: gyro xyz, accel xyz, counts. */
static const int16_t level[6] = {20, -12, 6, 100, -50, 8197};

static uint32_t next_index;

static struct wire_imu_batch batch_of(const int16_t counts[6], int16_t wobble)
{
	struct wire_imu_batch batch = {
		.flags = WIRE_IMU_FLAG_HARDWARE_TIME,
		.accel_fs_g = FS_G,
		.gyro_fs_dps = FS_DPS,
		.sample_index = next_index,
		.t_first_ticks_node = TICKS_PER_S + (uint64_t)next_index * PERIOD_TICKS,
		.period_ticks = PERIOD_TICKS * 256U,
		.temperature_cdegc = 2750,
		.count = BATCH,
	};

	for (uint32_t i = 0; i < BATCH; i++) {
		memcpy(batch.samples[i].gyro_lsb, counts, 6);
		memcpy(batch.samples[i].accel_lsb, counts + 3, 6);
		batch.samples[i].gyro_lsb[0] += i % 2U == 0U ? wobble : -wobble;
	}
	next_index += BATCH;
	return batch;
}

/* @return flags of the last batch. */
static uint8_t feed(uint32_t batches, const int16_t counts[6], int16_t wobble)
{
	uint8_t flags = 0;

	for (uint32_t i = 0; i < batches; i++) {
		struct wire_imu_batch batch = batch_of(counts, wobble);

		cal_take(&batch);
		flags = batch.flags;
	}
	return flags;
}

static void boot(void)
{
	memset(&line, 0, sizeof(line));
	cal_init(DEVICE_ID);
}

/* Once, before anything else has happened: the line is open before the store is. */
static void *setup(void)
{
	const struct wire_cal_record record = {0};

	zassert_equal(cal_command(WIRE_NODE_COMMAND_CAL_ERASE), -EAGAIN);
	zassert_equal(cal_take_record(&record), -EAGAIN);
	return NULL;
}

static void before(void *unused)
{
	ARG_UNUSED(unused);
	zassert_ok(flash_erase(flash, AREA, AREA_SIZE));
	next_index = 0;
	boot();
}

static struct wire_cal_record record_for(const int16_t gyro_lsb[3])
{
	struct wire_cal_record record = {
		.device_id = DEVICE_ID,
		.created_unix_s = 1790000000U,
		/* 100 counts of x at 4 g. */
		.accel_bias_mps2 = {(float)(100 * 0.122e-3 * 9.80665), 0.0f, 0.0f},
		.accel_matrix = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0625f},
	};

	for (int i = 0; i < 3; i++) {
		record.gyro_bias_radps[i] = (float)(gyro_lsb[i] * 0.035 * RADPS_PER_DPS);
	}
	return record;
}

ZTEST_SUITE(calib, NULL, setup, before, NULL, NULL);

ZTEST(calib, test_batches_are_as_the_sensor_made_them_until_the_check_has_decided)
{
	zassert_false(cal_ready());
	for (uint32_t i = 0; i < RATE_HZ / BATCH; i++) {
		struct wire_imu_batch batch = batch_of(level, 0);
		const struct wire_imu_batch raw = batch;

		cal_take(&batch);
		zassert_equal(batch.flags,
			      WIRE_IMU_FLAG_HARDWARE_TIME | WIRE_IMU_FLAG_UNCORRECTED);
		zassert_mem_equal(batch.samples, raw.samples, sizeof(raw.samples));
	}
	zassert_false(cal_ready());
	zassert_equal(line.statuses, 0);
}

ZTEST(calib, test_a_still_second_makes_it_ready_and_the_rate_zero)
{
	struct wire_imu_batch batch;

	zassert_equal(feed(RATE_HZ / BATCH + 1U, level, 0),
		      WIRE_IMU_FLAG_HARDWARE_TIME | WIRE_IMU_FLAG_UNCORRECTED);
	zassert_true(cal_ready());
	batch = batch_of(level, 0);
	cal_take(&batch);
	zassert_equal(batch.flags, WIRE_IMU_FLAG_HARDWARE_TIME);
	for (uint32_t i = 0; i < BATCH; i++) {
		for (int axis = 0; axis < 3; axis++) {
			zassert_equal(batch.samples[i].gyro_lsb[axis], 0);
			zassert_equal(batch.samples[i].accel_lsb[axis], level[3 + axis]);
		}
	}
	zassert_equal(line.statuses, 1);
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_DEFAULTS);
	zassert_equal(line.status.reason, WIRE_CAL_REASON_ABSENT);
	/* 24 counts of 35 mdps are 0.84 dps away from the default of 0. */
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_WARNED);
	zassert_within(line.status.boot_delta_dps, 0.8430f, 1e-4f);
	zassert_within(line.status.gyro_bias_radps[0], (float)(20 * 0.035 * RADPS_PER_DPS), 1e-6f);
	zassert_equal(line.status.boot_attempts, 1);
	zassert_equal(line.status.ready, 1);
	zassert_equal(line.status.temperature_cdegc, 2750);
	/* The sample one second after the first. */
	zassert_equal(line.status.t_ticks_node, 2U * TICKS_PER_S);
	zassert_equal(line.faults, 0);
}

ZTEST(calib, test_motion_is_reported_at_once_and_waited_out)
{
	/* 40 counts are 1.4 dps. */
	feed(RATE_HZ / BATCH + 1U, level, 40);
	zassert_equal(line.statuses, 1);
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_MOVING);
	zassert_equal(line.status.ready, 0);
	feed(4U * RATE_HZ / BATCH, level, 40);
	zassert_equal(line.statuses, 1);
	zassert_false(cal_ready());
	feed(2U * RATE_HZ / BATCH + 1U, level, 0);
	zassert_true(cal_ready());
	zassert_equal(line.statuses, 2);
	zassert_between_inclusive(line.status.boot_attempts, 6, 7);
}

ZTEST(calib, test_a_restart_of_the_imu_drops_the_window_and_no_decision)
{
	feed(10, level, 0);
	cal_restart();
	feed(10, level, 0);
	zassert_false(cal_ready());
	feed(4, level, 0);
	zassert_true(cal_ready());
	cal_restart();
	zassert_true(cal_ready());
	zassert_equal(feed(1, level, 0), WIRE_IMU_FLAG_HARDWARE_TIME);
	zassert_equal(line.statuses, 1);
}

ZTEST(calib, test_a_bias_too_far_from_the_stored_one_is_refused)
{
	/* 60 counts of 35 mdps on one axis: 2.1 dps. */
	const int16_t gyro_lsb[3] = {level[0], level[1], level[2] + 60};
	const struct wire_cal_record record = record_for(gyro_lsb);
	struct wire_imu_batch batch;

	zassert_ok(cal_take_record(&record));
	boot();
	feed(20, level, 0);
	zassert_true(cal_ready());
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_REFUSED);
	zassert_equal(line.faults, 1);
	zassert_equal(line.fault_code, WIRE_FAULT_CODE_CAL_BIAS_REFUSED);
	zassert_within(line.fault_argument, 2100U, 1U);
	batch = batch_of(level, 0);
	cal_take(&batch);
	/* The stored bias stays in force. */
	zassert_equal(batch.samples[0].gyro_lsb[2], -60);
	zassert_equal(batch.samples[0].gyro_lsb[0], 0);
}

ZTEST(calib, test_a_record_is_in_force_at_once_and_after_a_restart)
{
	const struct wire_cal_record record = record_for(level);
	struct wire_imu_batch batch;
	uint32_t crc32;

	feed(20, level, 0);
	memset(&line, 0, sizeof(line));
	zassert_ok(cal_take_record(&record));
	zassert_equal(line.records, 1);
	zassert_mem_equal(line.record.accel_bias_mps2, record.accel_bias_mps2,
			  sizeof(record.accel_bias_mps2));
	zassert_equal(line.record.device_id, DEVICE_ID);
	zassert_equal(line.statuses, 1);
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_STORED);
	zassert_equal(line.status.reason, WIRE_CAL_REASON_NONE);
	zassert_equal(line.status.ready, 1);
	/* The decision of the boot check stays what it was. */
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_WARNED);
	zassert_not_equal(line.status.record_crc32, 0);
	crc32 = line.status.record_crc32;
	batch = batch_of(level, 0);
	cal_take(&batch);
	zassert_equal(batch.samples[0].accel_lsb[0], 0);
	zassert_equal(batch.samples[0].accel_lsb[1], -50);
	/* 8197 * 1.0625 = 8709.3 */
	zassert_equal(batch.samples[0].accel_lsb[2], 8709);

	boot();
	cal_report();
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_STORED);
	zassert_equal(line.status.record_crc32, crc32);
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_PENDING);
	zassert_equal(line.status.ready, 0);
	feed(20, level, 0);
	zassert_equal(line.status.boot_check, WIRE_BOOT_CHECK_APPLIED);
	zassert_within(line.status.boot_delta_dps, 0.0f, 1e-3f);
}

ZTEST(calib, test_records_that_cannot_be_are_refused)
{
	struct wire_cal_record foreign = record_for(level);
	struct wire_cal_record impossible = record_for(level);

	foreign.device_id ^= 1U;
	impossible.accel_matrix[8] = 1.2f;
	zassert_equal(cal_take_record(&foreign), -EINVAL);
	zassert_equal(cal_take_record(&impossible), -EINVAL);
	zassert_equal(line.records, 0);
	cal_report();
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_DEFAULTS);
	zassert_ok(cal_command(WIRE_NODE_COMMAND_CAL_READ));
	zassert_equal(line.records, 0);
	zassert_equal(line.status.reason, WIRE_CAL_REASON_ABSENT);
}

ZTEST(calib, test_read_and_erase)
{
	const struct wire_cal_record record = record_for(level);

	zassert_ok(cal_take_record(&record));
	zassert_ok(cal_command(WIRE_NODE_COMMAND_CAL_READ));
	zassert_equal(line.records, 2);
	zassert_ok(cal_command(WIRE_NODE_COMMAND_CAL_ERASE));
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_DEFAULTS);
	zassert_equal(line.status.reason, WIRE_CAL_REASON_ABSENT);
	zassert_equal(line.status.record_crc32, 0);
	zassert_equal(line.status.accel_matrix[8], 1.0f);
	zassert_equal(line.status.accel_bias_mps2[0], 0.0f);
	zassert_ok(cal_command(WIRE_NODE_COMMAND_CAL_READ));
	zassert_equal(line.records, 2);
}

ZTEST(calib, test_raw_switches_the_correction_off_and_on)
{
	struct wire_imu_batch batch;

	feed(20, level, 0);
	zassert_ok(cal_command(WIRE_NODE_COMMAND_RAW_ON));
	zassert_equal(line.status.raw, 1);
	batch = batch_of(level, 0);
	cal_take(&batch);
	zassert_equal(batch.samples[0].gyro_lsb[0], level[0]);
	zassert_equal(batch.flags, WIRE_IMU_FLAG_HARDWARE_TIME | WIRE_IMU_FLAG_UNCORRECTED);
	zassert_ok(cal_command(WIRE_NODE_COMMAND_RAW_OFF));
	zassert_equal(line.status.raw, 0);
	batch = batch_of(level, 0);
	cal_take(&batch);
	zassert_equal(batch.samples[0].gyro_lsb[0], 0);
	zassert_equal(batch.flags, WIRE_IMU_FLAG_HARDWARE_TIME);
}

ZTEST(calib, test_the_check_goes_on_while_raw)
{
	zassert_ok(cal_command(WIRE_NODE_COMMAND_RAW_ON));
	zassert_equal(feed(20, level, 0), WIRE_IMU_FLAG_HARDWARE_TIME | WIRE_IMU_FLAG_UNCORRECTED);
	zassert_true(cal_ready());
}

ZTEST(calib, test_other_scales_are_corrected_in_their_own_counts)
{
	struct wire_imu_batch batch;

	feed(20, level, 0);
	batch = batch_of(level, 0);
	batch.gyro_fs_dps = 2U * FS_DPS;
	cal_take(&batch);
	/* 20 counts of bias at 1000 dps are 10 at 2000. */
	zassert_equal(batch.samples[0].gyro_lsb[0], level[0] - 10);
}

ZTEST(calib, test_other_commands_are_refused)
{
	zassert_equal(cal_command(0), -EINVAL);
	zassert_equal(cal_command(WIRE_NODE_COMMAND_REBOOT), -EINVAL);
	zassert_equal(cal_command(200), -EINVAL);
}

ZTEST(calib, test_a_store_that_had_to_be_cleared_is_a_fault)
{
	for (uint32_t at = 0; at < AREA_SIZE; at += 4U) {
		const uint32_t word = 0x12345678U;

		zassert_ok(flash_write(flash, AREA + at, &word, sizeof(word)));
	}
	boot();
	zassert_equal(line.faults, 1);
	zassert_equal(line.fault_code, WIRE_FAULT_CODE_CAL_STORE);
	cal_report();
	zassert_equal(line.status.reason, WIRE_CAL_REASON_FLASH);
	zassert_equal(line.status.origin, WIRE_CAL_ORIGIN_DEFAULTS);
	boot();
	zassert_equal(line.faults, 0);
	cal_report();
	zassert_equal(line.status.reason, WIRE_CAL_REASON_ABSENT);
}
