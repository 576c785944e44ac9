/* SPDX-License-Identifier: Apache-2.0 */
#include "imu_source.h"

#include <errno.h>

#include <zephyr/kernel.h>

#include "calib.h"
#include "diag_report.h"
#include "diag_uart.h"
#include "imu_decimate.h"
#include "lsm6dsox.h"
#include "sync_timer.h"
#include "watchdog.h"

#define STATS_PERIOD K_SECONDS(1)

/* What faster rates are brought down to. */
#define DECIMATED_MAX_HZ 1000U

#define ODR_MIN_HZ 12.0f
#define ODR_MAX_HZ 6700.0f
#define REST_NEVER UINT16_MAX

static const struct device *const imu = DEVICE_DT_GET(DT_COMPAT_GET_ANY_STATUS_OKAY(st_lsm6dsox));

static struct imu_decimate decimate;
static imu_source_batch_cb batch_cb;
static uint8_t factor;
static bool started;

static void send_stats(struct k_work *work);
static K_WORK_DELAYABLE_DEFINE(stats_work, send_stats);

static void send_stats(struct k_work *work)
{
	struct lsm6dsox_stats stats;
	struct wire_fifo_stats frame;
	uint8_t payload[WIRE_FIFO_STATS_SIZE];

	ARG_UNUSED(work);
	lsm6dsox_get_stats(imu, &stats);
	frame = (struct wire_fifo_stats){
		.t_ticks_node = sync_timer_now_ticks(),
		.samples = stats.samples,
		.batches = stats.bursts,
		.overruns = stats.overruns,
		.tag_gaps = stats.fifo.tag_gaps + stats.fifo.words_out_of_sequence +
			    stats.fifo.unknown_tags,
		.parity_errors = stats.fifo.parity_errors,
		.config_changes = stats.fifo.config_changes,
		.short_reads = stats.fifo.short_reads,
		.bus_errors = stats.bus_errors,
		.missed_edges = stats.missed_edges,
		.level_max = stats.level_max,
		.watermark = stats.watermark,
		.bus_busy_us = (uint32_t)(stats.bus_busy_ticks / SYNC_TICKS_PER_US),
		.odr_hz = stats.odr_hz,
		.decimation = factor,
		.samples_crc32 = stats.samples_crc32,
		.samples_unsettled = stats.pairs_unsettled,
		.slots_by_time = stats.slots_resolved_by_time,
		.edges_refused = stats.edges_refused,
		.restarts = (uint16_t)stats.restarts,
		.wake_ups = (uint16_t)stats.wake_ups,
		.wake_to_sample_us = stats.wake_to_sample_us,
	};
	diag_uart_frame(WIRE_FIFO_STATS_ID, payload, wire_fifo_stats_put(payload, &frame));
	(void)k_work_schedule(&stats_work, STATS_PERIOD);
}

static void on_decimated(void *context, const struct wire_imu_batch *batch)
{
	/* Too large for the stack, and the driver has one thread. */
	static struct wire_imu_batch own;

	ARG_UNUSED(context);
	own = *batch;
	cal_take(&own);
	batch_cb(&own);
}

static void on_batch(const struct wire_imu_batch *batch)
{
	watchdog_begin(WATCHDOG_SENSOR);
	imu_decimate_push(&decimate, batch, on_decimated, NULL);
	watchdog_end(WATCHDOG_SENSOR);
}

static uint8_t decimation(uint32_t rate_hz)
{
	uint32_t chosen = 1;

	if (CONFIG_BV_IMU_DECIMATION > 0) {
		return CONFIG_BV_IMU_DECIMATION;
	}
	while (rate_hz > CONFIG_BV_IMU_STREAM_MAX_HZ && rate_hz / chosen > DECIMATED_MAX_HZ) {
		chosen *= 2U;
	}
	return (uint8_t)chosen;
}

static int start(struct lsm6dsox_options *options)
{
	static const struct lsm6dsox_callbacks callbacks = {
		.on_batch = on_batch,
		.on_fault = diag_report_fault,
	};

	factor = decimation(options->rate_hz);
	if (factor > 1U) {
		/* The filter makes batches of its own: fewer, longer bursts from the FIFO. */
		options->batch_samples = WIRE_IMU_BATCH_MAX_COUNT;
	}
	imu_decimate_init(&decimate, factor, CONFIG_BV_IMU_BATCH);
	cal_restart();
	return lsm6dsox_start(imu, options, &callbacks);
}

int imu_source_start(imu_source_batch_cb on_source_batch)
{
	struct lsm6dsox_options options;
	int err;

	batch_cb = on_source_batch;
	lsm6dsox_default_options(imu, &options);
	err = start(&options);
	if (!err) {
		started = true;
		(void)k_work_schedule(&stats_work, STATS_PERIOD);
	}
	return err;
}

static bool is_rate(float odr_hz)
{
	/* False for what is no number, too. */
	return odr_hz >= ODR_MIN_HZ && odr_hz <= ODR_MAX_HZ;
}

static bool is_accel_scale(uint8_t fs_g)
{
	return fs_g == 2U || fs_g == 4U || fs_g == 8U || fs_g == 16U;
}

static bool is_gyro_scale(uint16_t fs_dps)
{
	return fs_dps == 125U || fs_dps == 250U || fs_dps == 500U || fs_dps == 1000U ||
	       fs_dps == 2000U;
}

int imu_source_setup(const struct wire_imu_setup *setup)
{
	struct lsm6dsox_options options;

	if (!started) {
		return -EAGAIN;
	}
	if ((setup->odr_hz != 0.0f && !is_rate(setup->odr_hz)) ||
	    (setup->accel_fs_g != 0U && !is_accel_scale(setup->accel_fs_g)) ||
	    (setup->gyro_fs_dps != 0U && !is_gyro_scale(setup->gyro_fs_dps))) {
		return -EINVAL;
	}
	lsm6dsox_default_options(imu, &options);
	if (setup->odr_hz != 0.0f) {
		options.rate_hz = (uint16_t)setup->odr_hz;
	}
	if (setup->accel_fs_g != 0U) {
		options.accel_fs_g = setup->accel_fs_g;
	}
	if (setup->gyro_fs_dps != 0U) {
		options.gyro_fs_dps = setup->gyro_fs_dps;
	}
	if (setup->rest_s != 0U) {
		options.rest_s = setup->rest_s == REST_NEVER ? 0U : setup->rest_s;
	}
	lsm6dsox_stop(imu);
	return start(&options);
}
