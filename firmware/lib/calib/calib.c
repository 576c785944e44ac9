/* SPDX-License-Identifier: Apache-2.0 */
#include "calib.h"

#include <errno.h>
#include <string.h>

#include <zephyr/kernel.h>
#include <zephyr/sys/atomic.h>
#include <zephyr/sys/util.h>

#include "calib_boot.h"
#include "calib_correct.h"
#include "calib_record.h"
#include "calib_store.h"
#include "diag_report.h"
#include "diag_uart.h"
#include "sync_timer.h"

#define MDPS_PER_DPS 1000.0f

static const struct calib_values defaults = {
	.accel_bias_mps2 = {
		CONFIG_BV_CAL_ACCEL_BIAS_X_UMPS2 / 1e6f,
		CONFIG_BV_CAL_ACCEL_BIAS_Y_UMPS2 / 1e6f,
		CONFIG_BV_CAL_ACCEL_BIAS_Z_UMPS2 / 1e6f,
	},
	.accel_matrix = {
		CONFIG_BV_CAL_ACCEL_M_XX_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_XY_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_XZ_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_YX_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_YY_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_YZ_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_ZX_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_ZY_PPM / 1e6f,
		CONFIG_BV_CAL_ACCEL_M_ZZ_PPM / 1e6f,
	},
	.gyro_bias_radps = {
		CONFIG_BV_CAL_GYRO_BIAS_X_URADPS / 1e6f,
		CONFIG_BV_CAL_GYRO_BIAS_Y_URADPS / 1e6f,
		CONFIG_BV_CAL_GYRO_BIAS_Z_URADPS / 1e6f,
	},
};

static atomic_t g_cal_ready;
/* The store is open: commands may come before. */
static atomic_t initialised;

/* The IMU's thread corrects, the system work queue takes commands, the main thread reports. Never
 * held over flash or the line.
 */
static K_MUTEX_DEFINE(lock);

static struct {
	uint64_t device_id;
	struct calib_values values;
	uint8_t origin;
	uint8_t reason;
	uint32_t record_crc32;
	bool raw;

	struct calib_boot boot;
	uint8_t boot_check;
	float boot_delta_dps;
	uint64_t t_decided_ticks;
	int16_t temperature_cdegc;

	/* The values in counts, for these scales; 0 g: for none yet. */
	struct calib_correct correct;
	uint8_t accel_fs_g;
	uint16_t gyro_fs_dps;
} cal;

/* --- what is in force ------------------------------------------------------------------------ */

/* The lock is held. */
static void put_in_force(const struct calib_values *values, uint8_t origin, uint8_t reason,
			 uint32_t crc32)
{
	cal.values = *values;
	cal.origin = origin;
	cal.reason = reason;
	cal.record_crc32 = crc32;
	cal.accel_fs_g = 0;
}

static void put_defaults_in_force(uint8_t reason)
{
	(void)k_mutex_lock(&lock, K_FOREVER);
	put_in_force(&defaults, WIRE_CAL_ORIGIN_DEFAULTS, reason, 0);
	(void)k_mutex_unlock(&lock);
}

static void put_record_in_force(const struct wire_cal_record *record, uint32_t crc32)
{
	struct calib_values values;

	BUILD_ASSERT(sizeof(values.accel_matrix) == sizeof(record->accel_matrix));
	memcpy(values.accel_bias_mps2, record->accel_bias_mps2, sizeof(values.accel_bias_mps2));
	memcpy(values.accel_matrix, record->accel_matrix, sizeof(values.accel_matrix));
	memcpy(values.gyro_bias_radps, record->gyro_bias_radps, sizeof(values.gyro_bias_radps));
	(void)k_mutex_lock(&lock, K_FOREVER);
	put_in_force(&values, WIRE_CAL_ORIGIN_STORED, WIRE_CAL_REASON_NONE, crc32);
	(void)k_mutex_unlock(&lock);
}

static void report_store(int err, const char *detail)
{
	diag_report_fault(WIRE_FAULT_CODE_CAL_STORE, (uint32_t)-err, detail);
}

void cal_init(uint64_t device_id)
{
	struct wire_cal_record record;
	uint32_t crc32 = 0;
	const int err = calib_store_open(device_id);
	uint8_t reason = calib_store_load(&record, &crc32);

	memset(&cal, 0, sizeof(cal));
	atomic_clear(&g_cal_ready);
	cal.device_id = device_id;
	if (err == -EIO) {
		report_store(err, "store damaged, its record is used: erase it");
	} else if (err == -EILSEQ) {
		/* What was in it is gone: more than merely absent. */
		reason = WIRE_CAL_REASON_FLASH;
		report_store(err, "store held no record, was damaged: cleared");
	} else if (err) {
		report_store(err, "store does not open");
	}
	if (reason == WIRE_CAL_REASON_NONE) {
		put_record_in_force(&record, crc32);
	} else {
		put_defaults_in_force(reason);
	}
	atomic_set(&initialised, 1);
}

bool cal_ready(void)
{
	return atomic_get(&g_cal_ready) != 0;
}

/* --- reports --------------------------------------------------------------------------------- */

static void fill_status(struct wire_cal_status *status)
{
	(void)k_mutex_lock(&lock, K_FOREVER);
	*status = (struct wire_cal_status){
		.t_ticks_node = cal_ready() ? cal.t_decided_ticks : sync_timer_now_ticks(),
		.origin = cal.origin,
		.reason = cal.reason,
		.boot_check = cal.boot_check,
		.boot_attempts = (uint8_t)MIN(cal.boot.attempts, UINT8_MAX),
		.ready = cal_ready() ? 1U : 0U,
		.raw = cal.raw ? 1U : 0U,
		.record_crc32 = cal.record_crc32,
		.boot_delta_dps = cal.boot_delta_dps,
		.temperature_cdegc = cal.temperature_cdegc,
	};
	memcpy(status->accel_bias_mps2, cal.values.accel_bias_mps2,
	       sizeof(status->accel_bias_mps2));
	memcpy(status->accel_matrix, cal.values.accel_matrix, sizeof(status->accel_matrix));
	memcpy(status->gyro_bias_radps, cal.values.gyro_bias_radps,
	       sizeof(status->gyro_bias_radps));
	(void)k_mutex_unlock(&lock);
}

static void send_status(const struct wire_cal_status *status)
{
	uint8_t payload[WIRE_CAL_STATUS_SIZE];

	diag_uart_frame(WIRE_CAL_STATUS_ID, payload, wire_cal_status_put(payload, status));
}

void cal_report(void)
{
	struct wire_cal_status status;

	fill_status(&status);
	send_status(&status);
}

static void send_record(const struct wire_cal_record *record)
{
	uint8_t payload[WIRE_CAL_RECORD_SIZE];

	diag_uart_frame(WIRE_CAL_RECORD_ID, payload, wire_cal_record_put(payload, record));
}

/* --- boot check ------------------------------------------------------------------------------ */

void cal_restart(void)
{
	(void)k_mutex_lock(&lock, K_FOREVER);
	calib_boot_restart(&cal.boot);
	(void)k_mutex_unlock(&lock);
}

static void decide(const struct wire_imu_batch *batch)
{
	cal.boot_check = calib_boot_decide(cal.boot.gyro_bias_radps, cal.values.gyro_bias_radps,
					   &cal.boot_delta_dps);
	if (cal.boot_check != WIRE_BOOT_CHECK_REFUSED) {
		memcpy(cal.values.gyro_bias_radps, cal.boot.gyro_bias_radps,
		       sizeof(cal.values.gyro_bias_radps));
		cal.accel_fs_g = 0;
	}
	cal.t_decided_ticks = cal.boot.t_last_ticks;
	cal.temperature_cdegc = batch->temperature_cdegc;
	atomic_set(&g_cal_ready, 1);
}

static void to_si(float si[3], const int16_t lsb[3], float si_per_lsb)
{
	for (int i = 0; i < 3; i++) {
		si[i] = (float)lsb[i] * si_per_lsb;
	}
}

/* One batch to the boot check. @return whether its state has changed. */
static bool check(const struct wire_imu_batch *batch)
{
	const float radps_per_lsb = calib_gyro_radps_per_lsb(batch->gyro_fs_dps);
	const float mps2_per_lsb = calib_accel_mps2_per_lsb(batch->accel_fs_g);
	const uint8_t before = cal.boot_check;

	for (uint32_t i = 0; i < batch->count && !cal_ready(); i++) {
		const uint64_t since_subticks = (uint64_t)i * batch->period_ticks;
		float gyro_radps[3];
		float accel_mps2[3];

		to_si(gyro_radps, batch->samples[i].gyro_lsb, radps_per_lsb);
		to_si(accel_mps2, batch->samples[i].accel_lsb, mps2_per_lsb);
		switch (calib_boot_push(&cal.boot, batch->t_first_ticks_node + (since_subticks >> 8),
					gyro_radps, accel_mps2)) {
		case CALIB_BOOT_STILL:
			decide(batch);
			break;
		case CALIB_BOOT_MOVED:
			cal.boot_check = WIRE_BOOT_CHECK_MOVING;
			break;
		case CALIB_BOOT_OPEN:
			break;
		}
	}
	return cal.boot_check != before;
}

/* --- samples --------------------------------------------------------------------------------- */

static void correct(struct wire_imu_batch *batch)
{
	if (batch->accel_fs_g != cal.accel_fs_g || batch->gyro_fs_dps != cal.gyro_fs_dps) {
		calib_correct_prepare(&cal.correct, &cal.values, batch->accel_fs_g,
				      batch->gyro_fs_dps);
		cal.accel_fs_g = batch->accel_fs_g;
		cal.gyro_fs_dps = batch->gyro_fs_dps;
	}
	for (uint32_t i = 0; i < batch->count; i++) {
		struct wire_imu_batch_samples *sample = &batch->samples[i];

		calib_correct_accel(&cal.correct, sample->accel_lsb, sample->accel_lsb);
		calib_correct_gyro(&cal.correct, sample->gyro_lsb, sample->gyro_lsb);
	}
}

void cal_take(struct wire_imu_batch *batch)
{
	bool changed = false;
	uint32_t refused_mdps = 0;

	(void)k_mutex_lock(&lock, K_FOREVER);
	if (cal_ready() && !cal.raw) {
		correct(batch);
	} else {
		batch->flags |= WIRE_IMU_FLAG_UNCORRECTED;
	}
	if (!cal_ready()) {
		changed = check(batch);
		refused_mdps = cal.boot_check == WIRE_BOOT_CHECK_REFUSED
				       ? (uint32_t)(cal.boot_delta_dps * MDPS_PER_DPS)
				       : 0U;
	}
	(void)k_mutex_unlock(&lock);
	if (refused_mdps > 0U) {
		diag_report_fault(WIRE_FAULT_CODE_CAL_BIAS_REFUSED, refused_mdps,
				  "gyro bias at boot too far from the stored one");
	}
	if (changed) {
		cal_report();
	}
}

/* --- commands -------------------------------------------------------------------------------- */

int cal_take_record(const struct wire_cal_record *record)
{
	struct wire_cal_record stored;
	uint32_t crc32;
	int err;

	if (!atomic_get(&initialised)) {
		return -EAGAIN;
	}
	if (calib_record_check(record, cal.device_id) != WIRE_CAL_REASON_NONE) {
		return -EINVAL;
	}
	err = calib_store_save(record);
	if (!err && calib_store_load(&stored, &crc32) != WIRE_CAL_REASON_NONE) {
		err = -EIO;
	}
	if (err) {
		report_store(err, "record not stored");
		return err;
	}
	put_record_in_force(&stored, crc32);
	send_record(&stored);
	cal_report();
	return 0;
}

static void answer_with_record(void)
{
	struct wire_cal_record record;
	struct wire_cal_status status;
	uint32_t crc32;
	const uint8_t reason = calib_store_load(&record, &crc32);

	if (reason == WIRE_CAL_REASON_NONE) {
		send_record(&record);
		return;
	}
	fill_status(&status);
	status.reason = reason;
	send_status(&status);
}

static int erase(void)
{
	const int err = calib_store_erase();

	if (err) {
		report_store(err, "record not erased");
		return err;
	}
	put_defaults_in_force(WIRE_CAL_REASON_ABSENT);
	cal_report();
	return 0;
}

static void set_raw(bool raw)
{
	(void)k_mutex_lock(&lock, K_FOREVER);
	cal.raw = raw;
	(void)k_mutex_unlock(&lock);
	cal_report();
}

int cal_command(uint8_t command)
{
	if (!atomic_get(&initialised)) {
		return -EAGAIN;
	}
	switch (command) {
	case WIRE_NODE_COMMAND_CAL_READ:
		answer_with_record();
		return 0;
	case WIRE_NODE_COMMAND_CAL_ERASE:
		return erase();
	case WIRE_NODE_COMMAND_RAW_ON:
	case WIRE_NODE_COMMAND_RAW_OFF:
		set_raw(command == WIRE_NODE_COMMAND_RAW_ON);
		return 0;
	default:
		return -EINVAL;
	}
}
