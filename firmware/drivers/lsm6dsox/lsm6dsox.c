/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include <soc_nrf_common.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/util.h>

#include "lsm6dsox_bus.h"
#include "lsm6dsox_config.h"
#include "lsm6dsox_edge.h"
#include "lsm6dsox_stream.h"
#include "sync_timer.h"

#define DT_DRV_COMPAT st_lsm6dsox

/* How long to leave a chip alone that could not be set up. */
#define SET_UP_RETRY     K_MSEC(100)
/* How often to ask whether a lost bus is back. */
#define BUS_RETRY        K_MSEC(20)
/* How often to look at a resting chip whose interrupt may not come. */
#define REST_POLL        K_SECONDS(2)
#define STATUS_TRIES     3U
#define SETTINGS_TRIES   3U
/* Watermarks without an edge, and time without one, after which the line counts as broken. */
#define MISSED_EDGES_MAX   3U
#define MISSING_EDGE_TICKS (500U * 1000U * SYNC_TICKS_PER_US)
/* Polls that found nothing new after which the chip is checked. */
#define SILENT_POLLS_MAX 2U
/* Rounds of one service; the level falls in each, unless the chip is mad. */
#define ROUNDS_MAX       8U

/* A FIFO that has overrun is full, less what a slot takes. */
#define OVERRUN_LEVEL_MIN (LSM6DSOX_FIFO_WORDS - 4U)

#define WORDS_PER_SAMPLE 2U
#define TEMPERATURE_PERIOD_TICKS (1000U * 1000U * SYNC_TICKS_PER_US)

/* What the FIFO said about itself. */
struct fifo_status {
	uint16_t level;
	bool overrun;
	uint64_t ticks;
};

/* How a service, or a state, ended. */
enum outcome {
	GO_ON,
	SET_UP_ANEW,
	REST,
	STOP,
};

struct device_config {
	struct spi_dt_spec spi;
	struct gpio_dt_spec int1;
	uint32_t int1_absolute_pin;
	uint32_t int1_latency_ns;
	uint32_t rate_hz;
	uint8_t accel_fs_g;
	uint16_t gyro_fs_dps;
	k_thread_stack_t *stack;
};

struct lsm6dsox_data {
	struct lsm6dsox_callbacks callbacks;
	struct lsm6dsox_settings settings;
	struct lsm6dsox_bus bus;
	struct lsm6dsox_edge edge;
	struct lsm6dsox_stream stream;
	/* The driver thread's own, and the copy that others may read. */
	struct lsm6dsox_stats stats;
	struct lsm6dsox_stats published;
	struct k_spinlock lock;
	struct k_thread thread;
	bool edge_ready;
	bool running;
	volatile bool stopping;

	k_timeout_t poll;
	uint32_t missed_in_row;
	uint64_t last_edge_ticks;
	uint32_t silent_polls;
	/* Code of the fault reported last, until the stream runs again. */
	uint16_t fault;
	uint64_t temperature_due_ticks;
	uint64_t woken_ticks;
	bool waking;
};

/* --- faults ---------------------------------------------------------------------------------- */

/* One report per outage, not one per attempt. */
static void report(struct lsm6dsox_data *d, uint16_t code, uint32_t argument, const char *detail)
{
	if (d->fault != code && d->callbacks.on_fault != NULL) {
		d->callbacks.on_fault(code, argument, detail);
	}
	d->fault = code;
}

static void report_identity(struct lsm6dsox_data *d, uint8_t who_am_i)
{
	char detail[WIRE_FAULT_DETAIL_COUNT + 1];

	if (who_am_i == 0x00U || who_am_i == 0xFFU) {
		snprintf(detail, sizeof(detail), "IMU silent (%02X): check CS SCK MISO MOSI, supply",
			 who_am_i);
	} else {
		snprintf(detail, sizeof(detail), "WHO_AM_I %02X is not 6C: check CS, MISO, part",
			 who_am_i);
	}
	report(d, WIRE_FAULT_CODE_IMU_WHO_AM_I, who_am_i, detail);
}

static void report_bus(struct lsm6dsox_data *d, int err)
{
	report(d, WIRE_FAULT_CODE_IMU_BUS, (uint32_t)-err,
	       "IMU bus lost: check SCK, MISO, MOSI, CS wires");
}

/* --- counters -------------------------------------------------------------------------------- */

/* Others see a whole set of counters, and never wait for the bus to get it. */
static void publish_stats(struct lsm6dsox_data *d)
{
	struct lsm6dsox_stats stats = d->stats;
	k_spinlock_key_t key;

	stats.fifo = d->stream.decoder.counters;
	stats.samples = d->stream.counters.samples;
	stats.samples_crc32 = d->stream.counters.samples_crc32;
	stats.pairs_unsettled = d->stream.counters.pairs_unsettled;
	stats.slots_resolved_by_time = d->stream.counters.slots_resolved_by_time;
	stats.edges_refused = d->stream.timing.edges_refused;
	stats.bus_errors = d->bus.errors;
	stats.bus_busy_ticks = d->bus.busy_ticks;
	stats.watermark = d->settings.watermark_words;
	/* The first set-up is no restart, and a wake-up none that anyone has to look into. */
	stats.restarts -= MIN(stats.restarts, 1U + stats.wake_ups);
	key = k_spin_lock(&d->lock);
	stats.level_max = MAX(d->stats.level_max, d->published.level_max);
	d->published = stats;
	k_spin_unlock(&d->lock, key);
	d->stats.level_max = 0;
}

/* --- set-up ---------------------------------------------------------------------------------- */

static int try_set_up(struct lsm6dsox_data *d)
{
	uint8_t who_am_i = 0;
	int err = lsm6dsox_config_identify(&d->bus, &who_am_i);

	if (err == -ENODEV) {
		report_identity(d, who_am_i);
		return err;
	}
	if (!err) {
		err = lsm6dsox_config_reset(&d->bus);
	}
	if (!err) {
		err = lsm6dsox_config_stream(&d->bus, &d->settings);
	}
	if (err == -EIO) {
		report(d, WIRE_FAULT_CODE_IMU_FIFO_CONFIG, 0,
		       "IMU registers do not hold what is written");
	} else if (err) {
		report_bus(d, err);
	}
	return err;
}

static int set_up(struct lsm6dsox_data *d)
{
	int8_t freq_fine = 0;
	int err = try_set_up(d);

	if (err) {
		return err;
	}
	if (d->stats.restarts == 0U && !lsm6dsox_config_freq_fine(&d->bus, &freq_fine)) {
		lsm6dsox_stream_set_rate(&d->stream,
					 lsm6dsox_rate_hz(d->settings.rate_code, freq_fine));
	}
	d->stats.restarts++;
	d->last_edge_ticks = sync_timer_now_ticks();
	d->missed_in_row = 0;
	d->silent_polls = 0;
	d->temperature_due_ticks = 0;
	return 0;
}

/* Stop, or try again later. */
static enum outcome set_up_until_it_works(struct lsm6dsox_data *d)
{
	while (set_up(d) != 0) {
		publish_stats(d);
		(void)lsm6dsox_edge_wait(&d->edge, SET_UP_RETRY);
		if (d->stopping) {
			return STOP;
		}
	}
	return GO_ON;
}

/* --- FIFO ------------------------------------------------------------------------------------ */

static bool is_plausible(uint16_t level, uint8_t flags, uint16_t watermark)
{
	lsm6dsox_fifo_status2_t bits;

	memcpy(&bits, &flags, sizeof(bits));
	return bits.not_used_01 == 0U && level <= LSM6DSOX_FIFO_WORDS &&
	       (bits.fifo_wtm_ia != 0U) == (level >= watermark);
}

/* One reading of level and flags. @return 0, -EBADMSG when they contradict each other, or errno. */
static int read_status_once(struct lsm6dsox_data *d, struct fifo_status *status)
{
	lsm6dsox_fifo_status2_t bits;
	const uint8_t *raw;
	const int err = lsm6dsox_bus_read(&d->bus, LSM6DSOX_FIFO_STATUS1, 2U, &raw);

	if (err) {
		return err;
	}
	memcpy(&bits, &raw[1], sizeof(bits));
	status->ticks = sync_timer_now_ticks();
	status->level = (uint16_t)(raw[0] | (uint16_t)bits.diff_fifo << 8);
	status->overrun = bits.over_run_latched != 0U || bits.fifo_ovr_ia != 0U;
	if (!is_plausible(status->level, raw[1], d->settings.watermark_words)) {
		d->bus.errors++;
		return -EBADMSG;
	}
	if (status->overrun && status->level < OVERRUN_LEVEL_MIN) {
		/* An overrun FIFO is full: this is a bit flipped on the way. */
		d->bus.errors++;
		status->overrun = false;
	}
	return 0;
}

/*
 * Read the FIFO's level and flags, again when they contradict each other.
 *
 * After a loss the level has to be that of a known instant, so then also when the transfer took
 * longer than it should: another thread, or another device on the bus, came in between.
 *
 * @return 0; -EBADMSG when they keep contradicting each other; or the error of the bus.
 */
static int read_status(struct lsm6dsox_data *d, struct fifo_status *status)
{
	const float slow_ticks = lsm6dsox_timing_period_ticks(&d->stream.timing);
	bool overrun = false;
	int result = -EBADMSG;

	for (uint32_t i = 0; i < STATUS_TRIES; i++) {
		const uint64_t start_ticks = sync_timer_now_ticks();
		struct fifo_status now;
		const int err = read_status_once(d, &now);

		if (err == -EBADMSG) {
			continue;
		}
		if (err) {
			return err;
		}
		/* The chip says it once. */
		overrun = overrun || now.overrun;
		*status = now;
		status->overrun = overrun;
		result = 0;
		if (!(overrun || d->stream.gap) ||
		    (float)(now.ticks - start_ticks) < slow_ticks) {
			break;
		}
	}
	return result;
}

static bool interrupt_is_missing(const struct lsm6dsox_data *d)
{
	return d->missed_in_row >= MISSED_EDGES_MAX &&
	       sync_timer_now_ticks() - d->last_edge_ticks > MISSING_EDGE_TICKS;
}

static int read_words(struct lsm6dsox_data *d, size_t words)
{
	while (words > 0U) {
		const size_t now = MIN(words, LSM6DSOX_BUS_WORDS_MAX);
		const uint8_t *data;
		const int err = lsm6dsox_bus_read(&d->bus, LSM6DSOX_FIFO_DATA_OUT_TAG,
						  now * LSM6DSOX_WORD_SIZE, &data);

		if (err) {
			return err;
		}
		d->stats.bursts++;
		lsm6dsox_stream_words(&d->stream, data, now * LSM6DSOX_WORD_SIZE);
		words -= now;
	}
	return 0;
}

/* One reading of the FIFO down to what @p status says. */
static int drain(struct lsm6dsox_data *d, const struct fifo_status *status, uint64_t edge_ticks,
		 bool has_edge)
{
	int err;

	d->stats.level_max = MAX(d->stats.level_max, status->level);
	if (status->overrun) {
		d->stats.overruns++;
	}
	/* Close to full, words may have gone between the status and the first word. */
	if (status->overrun || status->level >= OVERRUN_LEVEL_MIN) {
		lsm6dsox_stream_gap(&d->stream, status->overrun);
	} else if (has_edge) {
		lsm6dsox_stream_edge(&d->stream, edge_ticks);
	}
	lsm6dsox_edge_mask(&d->edge, true);
	err = read_words(d, status->level);
	lsm6dsox_edge_mask(&d->edge, false);
	if (err) {
		/* Some of the words may be gone. */
		lsm6dsox_stream_gap(&d->stream, false);
		return err;
	}
	lsm6dsox_stream_end(&d->stream, status->ticks, interrupt_is_missing(d));
	return 0;
}

/* The line rose, or should have: account for it. */
static void note_edge(struct lsm6dsox_data *d, bool in_time, const struct fifo_status *status)
{
	if (in_time) {
		d->last_edge_ticks = status->ticks;
		d->missed_in_row = 0;
		d->silent_polls = 0;
		if (d->fault == WIRE_FAULT_CODE_IMU_NO_INTERRUPT) {
			d->fault = 0;
		}
		return;
	}
	if (status->level < d->settings.watermark_words) {
		d->silent_polls++;
		return;
	}
	d->silent_polls = 0;
	d->stats.missed_edges++;
	d->missed_in_row++;
	if (interrupt_is_missing(d)) {
		report(d, WIRE_FAULT_CODE_IMU_NO_INTERRUPT, d->missed_in_row,
		       "no edge on INT1 at the watermark: check INT1");
	}
}

/* @return STOP, or GO_ON when the chip answers. */
static enum outcome wait_for_answer(struct lsm6dsox_data *d, int cause)
{
	uint8_t who_am_i;

	while (lsm6dsox_config_identify(&d->bus, &who_am_i) != 0) {
		/* No answer, or one that the chip cannot give. */
		d->bus.errors++;
		report_bus(d, cause);
		publish_stats(d);
		(void)lsm6dsox_edge_wait(&d->edge, BUS_RETRY);
		if (d->stopping) {
			return STOP;
		}
	}
	return GO_ON;
}

/*
 * Something is wrong with what comes from the chip. Most often it has sampled on, and nothing but
 * samples is lost; only if it has lost its settings, or makes no samples, is it set up anew.
 */
static enum outcome look_after_chip(struct lsm6dsox_data *d, int cause)
{
	int err = -EIO;

	lsm6dsox_stream_gap(&d->stream, false);
	if (wait_for_answer(d, cause) == STOP) {
		return STOP;
	}
	for (uint32_t i = 0; i < SETTINGS_TRIES && err != 0; i++) {
		err = lsm6dsox_config_check_stream(&d->bus, &d->settings);
	}
	if (err) {
		report(d, WIRE_FAULT_CODE_IMU_FIFO_CONFIG, (uint32_t)-err,
		       "IMU has lost its settings: check its supply");
		return SET_UP_ANEW;
	}
	d->silent_polls = 0;
	if (cause == -ENODATA && d->fault != WIRE_FAULT_CODE_IMU_BUS) {
		report(d, WIRE_FAULT_CODE_IMU_FIFO_CONFIG, 0, "IMU makes no samples");
		return SET_UP_ANEW;
	}
	d->fault = 0;
	return GO_ON;
}

static void read_temperature_when_due(struct lsm6dsox_data *d)
{
	const uint64_t now_ticks = sync_timer_now_ticks();

	if (now_ticks >= d->temperature_due_ticks) {
		d->temperature_due_ticks = now_ticks + TEMPERATURE_PERIOD_TICKS;
		(void)lsm6dsox_config_temperature(&d->bus, &d->stream.temperature_cdegc);
	}
}

/* Serve the FIFO once. @p in_time: an edge woke us, not the clock. */
static enum outcome serve(struct lsm6dsox_data *d, bool in_time)
{
	for (uint32_t round = 0; round < ROUNDS_MAX; round++) {
		struct fifo_status status;
		uint64_t edge_ticks;
		const bool has_edge = lsm6dsox_edge_take(&d->edge, &edge_ticks);
		int err = read_status(d, &status);

		if (err) {
			return look_after_chip(d, err);
		}
		if (round == 0U) {
			note_edge(d, in_time, &status);
		}
		if (status.level < d->settings.watermark_words && !status.overrun) {
			/* An edge that came while words were read, or a poll between two. */
			break;
		}
		err = drain(d, &status, edge_ticks, has_edge);
		if (err) {
			return look_after_chip(d, err);
		}
		if (!lsm6dsox_edge_is_active(&d->edge)) {
			break;
		}
	}
	if (d->silent_polls >= SILENT_POLLS_MAX) {
		return look_after_chip(d, -ENODATA);
	}
	read_temperature_when_due(d);
	return d->stream.resting ? REST : GO_ON;
}

/* Streaming; returns when something else has to be done. */
static enum outcome stream_while_possible(struct lsm6dsox_data *d)
{
	enum outcome outcome = GO_ON;

	while (outcome == GO_ON) {
		const bool in_time = lsm6dsox_edge_wait(&d->edge, d->poll) == 0;

		if (d->stopping) {
			return STOP;
		}
		outcome = serve(d, in_time);
		publish_stats(d);
	}
	return outcome;
}

/* --- rest ------------------------------------------------------------------------------------ */

/* Whether the chip says that something moved, whatever the interrupt line says. */
static bool has_moved(struct lsm6dsox_data *d)
{
	bool moved = false;

	if (lsm6dsox_edge_is_active(&d->edge)) {
		return true;
	}
	if (lsm6dsox_config_has_woken(&d->bus, &moved) == 0 && moved) {
		d->stats.missed_edges++;
		report(d, WIRE_FAULT_CODE_IMU_NO_INTERRUPT, 1U,
		       "no edge on INT1 at the wake-up: check INT1");
	}
	return moved;
}

/* Low power until something moves. */
static enum outcome rest(struct lsm6dsox_data *d)
{
	uint64_t edge_ticks;

	lsm6dsox_stream_flush(&d->stream);
	if (lsm6dsox_config_reset(&d->bus) != 0 ||
	    lsm6dsox_config_wake(&d->bus, &d->settings) != 0) {
		/* It will be set up anew, and what is wrong with it reported. */
		return SET_UP_ANEW;
	}
	(void)lsm6dsox_edge_take(&d->edge, &edge_ticks);
	publish_stats(d);
	while (!has_moved(d) && !d->stopping) {
		/* The edge wakes the node; the look now and then is for a broken line. */
		(void)lsm6dsox_edge_wait(&d->edge, REST_POLL);
	}
	if (d->stopping) {
		return STOP;
	}
	d->woken_ticks = lsm6dsox_edge_take(&d->edge, &edge_ticks) ? edge_ticks
								   : sync_timer_now_ticks();
	d->waking = true;
	d->stats.wake_ups++;
	return GO_ON;
}

/* --- thread ---------------------------------------------------------------------------------- */

static void run(void *p1, void *p2, void *p3)
{
	struct lsm6dsox_data *d = p1;
	bool count_missing = false;
	enum outcome outcome;

	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	do {
		outcome = set_up_until_it_works(d);
		if (outcome == GO_ON) {
			lsm6dsox_stream_restarted(&d->stream, sync_timer_now_ticks(),
						  count_missing);
			outcome = stream_while_possible(d);
		}
		count_missing = outcome == SET_UP_ANEW;
		if (outcome == REST) {
			outcome = rest(d);
		}
	} while (outcome != STOP);
	lsm6dsox_stream_flush(&d->stream);
	/* A reset powers both sensors down. */
	(void)lsm6dsox_config_reset(&d->bus);
	publish_stats(d);
	d->running = false;
}

static void on_batch(void *context, const struct wire_imu_batch *batch)
{
	struct lsm6dsox_data *d = context;

	d->fault = d->fault == WIRE_FAULT_CODE_IMU_NO_INTERRUPT ? d->fault : 0;
	if (d->waking) {
		d->waking = false;
		d->stats.wake_to_sample_us = (uint32_t)((sync_timer_now_ticks() - d->woken_ticks) /
							SYNC_TICKS_PER_US);
	}
	d->callbacks.on_batch(batch);
}

/* --- interface ------------------------------------------------------------------------------- */

static uint32_t either(uint32_t chosen, uint32_t otherwise)
{
	return chosen != 0U ? chosen : otherwise;
}

static struct lsm6dsox_rest rest_detector(const struct lsm6dsox_options *options, float rate_hz)
{
	/* 35 mdps per count at 1000 dps, 0.122 mg per count at 4 g. */
	return (struct lsm6dsox_rest){
		.gyro_lsb = options->rest_dps * 1000000 / (35 * options->gyro_fs_dps),
		.accel_lsb = options->rest_mg * 2000 / (61 * options->accel_fs_g),
		.needed = (uint32_t)((float)options->rest_s * rate_hz),
	};
}

static uint8_t samples_per_batch(const struct lsm6dsox_options *options, float rate_hz)
{
	return (uint8_t)CLAMP((int)(rate_hz * (float)options->batch_ms / 1000.0f), 1,
			      (int)options->batch_samples);
}

static void prepare(const struct device *dev, const struct lsm6dsox_options *options)
{
	const struct device_config *config = dev->config;
	struct lsm6dsox_data *d = dev->data;
	const uint8_t rate_code = lsm6dsox_rate_code(options->rate_hz);
	const float rate_hz = lsm6dsox_rate_hz(rate_code, 0);
	const uint8_t samples = samples_per_batch(options, rate_hz);
	const struct lsm6dsox_stream_params params = {
		.nominal_rate_hz = rate_hz,
		.timing = lsm6dsox_timing_defaults(),
		.edge_latency_ticks =
			(uint32_t)((uint64_t)config->int1_latency_ns * SYNC_TICKS_PER_US / 1000U),
		.watermark_words = WORDS_PER_SAMPLE * samples,
		.batch_samples = samples,
		.settling_slots = (uint32_t)(rate_hz * CONFIG_BV_LSM6DSOX_SETTLE_MS / 1000.0f),
		.accel_fs_g = options->accel_fs_g,
		.gyro_fs_dps = options->gyro_fs_dps,
		.rest = rest_detector(options, rate_hz),
		.context = d,
		.on_batch = on_batch,
	};

	d->settings = (struct lsm6dsox_settings){
		.rate_code = rate_code,
		.accel_fs_g = options->accel_fs_g,
		.gyro_fs_dps = options->gyro_fs_dps,
		.watermark_words = params.watermark_words,
		.wake_mg = options->wake_mg,
	};
	lsm6dsox_stream_init(&d->stream, &params);
	lsm6dsox_bus_init(&d->bus, &config->spi);
	/* Half a batch beyond the watermark, for a chip that is 10 % slow. */
	d->poll = K_USEC((uint32_t)(1.1f * 1.5e6f * samples / rate_hz) + 1000U);
	d->stats = (struct lsm6dsox_stats){.odr_hz = rate_hz};
	d->published = d->stats;
	d->fault = 0;
	d->waking = false;
	d->stopping = false;
}

void lsm6dsox_default_options(const struct device *dev, struct lsm6dsox_options *options)
{
	const struct device_config *config = dev->config;

	*options = (struct lsm6dsox_options){
		.rate_hz = (uint16_t)either(CONFIG_BV_IMU_RATE_HZ, config->rate_hz),
		.accel_fs_g = (uint8_t)either(CONFIG_BV_IMU_ACCEL_FS_G, config->accel_fs_g),
		.gyro_fs_dps = (uint16_t)either(CONFIG_BV_IMU_GYRO_FS_DPS, config->gyro_fs_dps),
		.batch_samples = CONFIG_BV_LSM6DSOX_BATCH_SAMPLES,
		.batch_ms = CONFIG_BV_LSM6DSOX_BATCH_MS,
		.rest_s = CONFIG_BV_LSM6DSOX_REST_S,
		.rest_dps = CONFIG_BV_LSM6DSOX_REST_DPS,
		.rest_mg = CONFIG_BV_LSM6DSOX_REST_MG,
		.wake_mg = CONFIG_BV_LSM6DSOX_WAKE_MG,
	};
}

int lsm6dsox_start(const struct device *dev, const struct lsm6dsox_options *options,
		   const struct lsm6dsox_callbacks *callbacks)
{
	const struct device_config *config = dev->config;
	struct lsm6dsox_data *d = dev->data;
	int err;

	if (d->running) {
		return -EALREADY;
	}
	if (!device_is_ready(dev) || !spi_is_ready_dt(&config->spi)) {
		return -ENODEV;
	}
	if (!d->edge_ready) {
		err = lsm6dsox_edge_init(&d->edge, &config->int1, config->int1_absolute_pin);
		if (err) {
			return err;
		}
		d->edge_ready = true;
	}
	d->callbacks = *callbacks;
	prepare(dev, options);
	d->running = true;
	(void)k_thread_create(&d->thread, config->stack, CONFIG_BV_LSM6DSOX_STACK_SIZE, run, d,
			      NULL, NULL, K_PRIO_PREEMPT(CONFIG_BV_LSM6DSOX_THREAD_PRIORITY), 0,
			      K_NO_WAIT);
	(void)k_thread_name_set(&d->thread, "lsm6dsox");
	return 0;
}

void lsm6dsox_stop(const struct device *dev)
{
	struct lsm6dsox_data *d = dev->data;

	if (d->running) {
		d->stopping = true;
		lsm6dsox_edge_kick(&d->edge);
		(void)k_thread_join(&d->thread, K_FOREVER);
	}
}

void lsm6dsox_get_stats(const struct device *dev, struct lsm6dsox_stats *stats)
{
	struct lsm6dsox_data *d = dev->data;
	const k_spinlock_key_t key = k_spin_lock(&d->lock);

	*stats = d->published;
	d->published.level_max = 0;
	k_spin_unlock(&d->lock, key);
}

#define LSM6DSOX_DEFINE(n)                                                                         \
	static K_THREAD_STACK_DEFINE(stack_##n, CONFIG_BV_LSM6DSOX_STACK_SIZE);                    \
	static struct lsm6dsox_data data_##n;                                                      \
	static const struct device_config config_##n = {                                         \
		.spi = SPI_DT_SPEC_INST_GET(                                                       \
			n, SPI_OP_MODE_MASTER | SPI_MODE_CPOL | SPI_MODE_CPHA | SPI_WORD_SET(8),   \
			0),                                                                        \
		.int1 = GPIO_DT_SPEC_INST_GET(n, int1_gpios),                                      \
		.int1_absolute_pin = NRF_DT_GPIOS_TO_PSEL(DT_DRV_INST(n), int1_gpios),             \
		.int1_latency_ns = DT_INST_PROP(n, int1_latency_ns),                               \
		.rate_hz = DT_INST_PROP(n, rate_hz),                                               \
		.accel_fs_g = DT_INST_PROP(n, accel_range_g),                                      \
		.gyro_fs_dps = DT_INST_PROP(n, gyro_range_dps),                                    \
		.stack = stack_##n,                                                                \
	};                                                                                         \
	DEVICE_DT_INST_DEFINE(n, NULL, NULL, &data_##n, &config_##n, POST_KERNEL,                  \
			      CONFIG_BV_LSM6DSOX_INIT_PRIORITY, NULL);

DT_INST_FOREACH_STATUS_OKAY(LSM6DSOX_DEFINE)
