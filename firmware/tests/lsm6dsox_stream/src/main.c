/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The driver against the chip model: every sample, its number and its time, at every rate, and what
 * becomes of them when something goes wrong.
 *
 * The model plays its pattern: the counts of a sample say which slot it is. So each sample that
 * comes out is checked against what the chip made, and its time against when it made it.
 */
#include <math.h>
#include <string.h>

#include <zephyr/ztest.h>

#include "lsm6dsox.h"
#include "model/model.h"
#include "sync_timer.h"

#define TICKS_PER_US  16
#define RATE_ERROR    (-0.068)
#define TOLERANCE_US  1.0
#define TOLERANCE_PPM 20.0

static const struct device *const imu = DEVICE_DT_GET(DT_NODELABEL(imu));

static struct {
	uint32_t batches;
	uint32_t samples;
	uint32_t holes;       /* Places where the index jumps */
	uint32_t missing;     /* Samples that the jumps leave out */
	uint32_t wrong;       /* Samples that are not what the chip made */
	uint32_t untimed;     /* Batches without hardware time */
	uint32_t overrun_flags;
	uint32_t next_index;
	uint32_t slot_minus_index; /* Of the first batch */
	uint32_t last_slot_minus_index;
	bool slot_matches_index;
	double worst_us;      /* Error of the batches with hardware time */
	double period_ticks;
	double worst_period_ppm; /* After three seconds */
	double true_period_ticks;
	uint64_t last_ticks;
	uint64_t start_us;
	uint64_t last_delivery_us;
	uint64_t longest_silence_us;
	uint16_t fault;
	uint32_t fault_argument;
	uint32_t faults;
	char fault_detail[WIRE_FAULT_DETAIL_COUNT + 1];
} seen;

/* Local time at tick 0, us. */
static double tick_zero_us;

static uint32_t slot_of(const struct wire_imu_batch_samples *sample)
{
	return (uint32_t)(uint16_t)sample->gyro_lsb[0] |
	       (uint32_t)(uint16_t)sample->gyro_lsb[1] << 14;
}

/* Whether a sample's number arrived unharmed: the accelerometer's counts repeat it, inverted. */
static bool is_intact(const struct wire_imu_batch_samples *sample)
{
	for (size_t i = 0; i < 3; i++) {
		if (sample->accel_lsb[i] != -1 - sample->gyro_lsb[i]) {
			return false;
		}
	}
	return true;
}

static void check_sample(const struct wire_imu_batch_samples *sample,
			 const struct lsm6dsox_model_slot *truth)
{
	if (memcmp(sample->gyro_lsb, truth->gyro_lsb, sizeof(truth->gyro_lsb)) != 0 ||
	    memcmp(sample->accel_lsb, truth->accel_lsb, sizeof(truth->accel_lsb)) != 0) {
		seen.wrong++;
	}
}

static void check_batch(const struct wire_imu_batch *batch)
{
	const uint32_t first_slot = slot_of(&batch->samples[0]);
	struct lsm6dsox_model_slot truth;

	if (!is_intact(&batch->samples[0])) {
		seen.wrong++;
		return;
	}

	for (uint32_t i = 0; i < batch->count; i++) {
		if (!lsm6dsox_model_truth(first_slot + i, &truth)) {
			seen.wrong++;
			continue;
		}
		check_sample(&batch->samples[i], &truth);
	}
	if (lsm6dsox_model_truth(first_slot, &truth) &&
	    (batch->flags & WIRE_IMU_FLAG_HARDWARE_TIME) != 0) {
		const double t_us = tick_zero_us + (double)batch->t_first_ticks_node / TICKS_PER_US;

		seen.worst_us = fmax(seen.worst_us, fabs(t_us - truth.t_us_local));
	}
	seen.last_slot_minus_index = first_slot - batch->sample_index;
	if (seen.batches == 0) {
		seen.slot_minus_index = seen.last_slot_minus_index;
		seen.slot_matches_index = true;
	} else if (seen.last_slot_minus_index != seen.slot_minus_index) {
		seen.slot_matches_index = false;
	}
}

static void on_batch(const struct wire_imu_batch *batch)
{
	const uint64_t now_us = lsm6dsox_model_now_us();

	check_batch(batch);
	if (seen.batches > 0) {
		seen.longest_silence_us =
			MAX(seen.longest_silence_us, now_us - seen.last_delivery_us);
		if (batch->sample_index != seen.next_index) {
			seen.holes++;
			seen.missing += batch->sample_index - seen.next_index;
		}
		zassert_true(batch->t_first_ticks_node > seen.last_ticks, "time runs backwards");
	}
	seen.untimed += (batch->flags & WIRE_IMU_FLAG_HARDWARE_TIME) == 0;
	seen.overrun_flags += (batch->flags & WIRE_IMU_FLAG_OVERRUN_BEFORE) != 0;
	seen.period_ticks = batch->period_ticks / 256.0;
	if (seen.true_period_ticks > 0.0 && now_us - seen.start_us > 3000000) {
		seen.worst_period_ppm =
			fmax(seen.worst_period_ppm,
			     1e6 * fabs(seen.period_ticks / seen.true_period_ticks - 1.0));
	}
	seen.next_index = batch->sample_index + batch->count;
	seen.last_ticks = batch->t_first_ticks_node;
	seen.last_delivery_us = now_us;
	seen.samples += batch->count;
	seen.batches++;
}

static void on_fault(uint16_t code, uint32_t argument, const char *detail)
{
	zassert_true(strlen(detail) <= WIRE_FAULT_DETAIL_COUNT, "'%s' is cut on the wire", detail);
	seen.fault = code;
	seen.fault_argument = argument;
	seen.faults++;
	strncpy(seen.fault_detail, detail, sizeof(seen.fault_detail) - 1);
}

static const struct lsm6dsox_callbacks callbacks = {
	.on_batch = on_batch,
	.on_fault = on_fault,
};

static void start(uint16_t rate_hz)
{
	struct lsm6dsox_options options;

	lsm6dsox_default_options(imu, &options);
	options.rate_hz = rate_hz;
	memset(&seen, 0, sizeof(seen));
	seen.start_us = lsm6dsox_model_now_us();
	zassert_ok(lsm6dsox_start(imu, &options, &callbacks));
}

static struct lsm6dsox_stats stop(void)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_stop(imu);
	lsm6dsox_get_stats(imu, &stats);
	return stats;
}

static void report(const char *what, const struct lsm6dsox_stats *s)
{
	TC_PRINT("%s: %u samples, worst %.2f us, period %.3f ticks, missing %u, silence %u ms, "
		 "bus %u us\n",
		 what, seen.samples, seen.worst_us, seen.period_ticks, seen.missing,
		 (unsigned int)(seen.longest_silence_us / 1000),
		 (unsigned int)(s->bus_busy_ticks / TICKS_PER_US));
	TC_PRINT("  parity %u unknown %u sequence %u gaps %u short %u lost %u overruns %u bus %u "
		 "missed %u refused %u by time %u restarts %u\n",
		 s->fifo.parity_errors, s->fifo.unknown_tags, s->fifo.words_out_of_sequence,
		 s->fifo.tag_gaps, s->fifo.short_reads, s->fifo.slots_lost, s->overruns,
		 s->bus_errors, s->missed_edges, s->edges_refused, s->slots_resolved_by_time,
		 s->restarts);
}

static void expect_no_errors(const struct lsm6dsox_stats *s)
{
	zexpect_equal(s->fifo.parity_errors, 0);
	zexpect_equal(s->fifo.unknown_tags, 0);
	zexpect_equal(s->fifo.words_out_of_sequence, 0);
	zexpect_equal(s->fifo.tag_gaps, 0);
	zexpect_equal(s->fifo.short_reads, 0);
	zexpect_equal(s->fifo.slots_lost, 0);
	zexpect_equal(s->overruns, 0);
	zexpect_equal(s->bus_errors, 0);
	zexpect_equal(s->missed_edges, 0);
	zexpect_equal(s->edges_refused, 0);
	zexpect_equal(s->restarts, 0);
	zexpect_equal(seen.faults, 0);
}

static void expect_sound_samples(void)
{
	zexpect_equal(seen.wrong, 0, "%u samples that the chip never made", seen.wrong);
	zexpect_true(seen.slot_matches_index, "the index does not count the chip's slots");
	zexpect_true(seen.worst_us <= TOLERANCE_US, "%.2f us off", seen.worst_us);
}

static double true_period_ticks(uint16_t rate_hz)
{
	const double octaves = round(log2(6667.0 / rate_hz));

	return TICKS_PER_US * 1e6 * exp2(octaves) / (6667.0 * (1.0 + RATE_ERROR));
}

static void *set_up_clock(void)
{
	zassert_ok(sync_timer_init());
	tick_zero_us = (double)lsm6dsox_model_now_us() -
		       (double)sync_timer_now_ticks() / TICKS_PER_US;
	return NULL;
}

static void before(void *fixture)
{
	ARG_UNUSED(fixture);
	lsm6dsox_model_set_faults(NULL);
	lsm6dsox_model_set_pattern(true);
	lsm6dsox_model_set_clock(RATE_ERROR, 0.0);
}

static void after(void *fixture)
{
	ARG_UNUSED(fixture);
	lsm6dsox_stop(imu);
	lsm6dsox_model_set_faults(NULL);
}

ZTEST_SUITE(lsm6dsox_stream, NULL, set_up_clock, before, after, NULL);

/* --- the ordinary case ----------------------------------------------------------------------- */

static void check_rate(uint16_t rate_hz, uint32_t seconds)
{
	const double expected = seconds * 16e6 / true_period_ticks(rate_hz);
	struct lsm6dsox_stats stats;
	char name[16];

	start(rate_hz);
	seen.true_period_ticks = true_period_ticks(rate_hz);
	k_sleep(K_SECONDS(seconds));
	stats = stop();
	TC_PRINT("worst period error %.2f ppm\n", seen.worst_period_ppm);
	snprintk(name, sizeof(name), "%u Hz", rate_hz);
	report(name, &stats);
	expect_no_errors(&stats);
	expect_sound_samples();
	zexpect_equal(seen.holes, 0);
	zexpect_equal(seen.untimed, 0);
	/* All but what was dropped while settling and what the FIFO still held. */
	zexpect_true(seen.samples + stats.pairs_unsettled > 0.98 * expected - 34.0);
	zexpect_equal(seen.samples, stats.samples);
	zexpect_within(1e6 * (seen.period_ticks / true_period_ticks(rate_hz) - 1.0), 0.0,
		       TOLERANCE_PPM);
	zexpect_true(seen.worst_period_ppm <= TOLERANCE_PPM, "%.1f ppm", seen.worst_period_ppm);
}

ZTEST(lsm6dsox_stream, test_12_5_hz)
{
	check_rate(12, 30);
}

ZTEST(lsm6dsox_stream, test_26_hz)
{
	check_rate(26, 20);
}

ZTEST(lsm6dsox_stream, test_52_hz)
{
	check_rate(52, 20);
}

ZTEST(lsm6dsox_stream, test_104_hz)
{
	check_rate(104, 20);
}

ZTEST(lsm6dsox_stream, test_208_hz)
{
	check_rate(208, 20);
}

ZTEST(lsm6dsox_stream, test_417_hz)
{
	check_rate(417, 20);
}

ZTEST(lsm6dsox_stream, test_833_hz)
{
	check_rate(833, 10);
}

ZTEST(lsm6dsox_stream, test_1667_hz)
{
	check_rate(1667, 10);
}

ZTEST(lsm6dsox_stream, test_3333_hz)
{
	check_rate(3333, 10);
}

ZTEST(lsm6dsox_stream, test_6667_hz_for_a_minute)
{
	check_rate(6667, 60);
}

ZTEST(lsm6dsox_stream, test_follows_a_chip_that_warms_up)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_model_set_clock(RATE_ERROR, 5e-6);
	start(417);
	k_sleep(K_SECONDS(30));
	stats = stop();
	report("5 ppm/s", &stats);
	expect_no_errors(&stats);
	expect_sound_samples();
}

ZTEST(lsm6dsox_stream, test_starts_again_after_a_stop)
{
	start(417);
	zexpect_equal(lsm6dsox_start(imu, &(struct lsm6dsox_options){0}, &callbacks), -EALREADY);
	k_sleep(K_SECONDS(2));
	(void)stop();
	check_rate(417, 5);
}

/* --- faults ---------------------------------------------------------------------------------- */

/* Stream at 417 Hz, with a fault from 3 s on, for 10 s. */
static struct lsm6dsox_stats stream_with(const char *fault)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_model_set_faults(fault);
	start(417);
	k_sleep(K_SECONDS(10));
	stats = stop();
	report(fault, &stats);
	expect_sound_samples();
	return stats;
}

static void expect_good_end(void)
{
	zexpect_true(lsm6dsox_model_now_us() - seen.last_delivery_us < 200000, "stream has ended");
	zexpect_equal(seen.last_slot_minus_index, seen.slot_minus_index,
		      "slots and index have drifted apart");
}

ZTEST(lsm6dsox_stream, test_dropped_edges_are_found_by_poll)
{
	const struct lsm6dsox_stats stats = stream_with("dropped_edge:3:4:0.2");

	zexpect_between_inclusive(stats.missed_edges, 5, 40);
	zexpect_equal(stats.restarts, 0);
	zexpect_equal(seen.holes, 0, "a sample was lost for want of an edge");
	zexpect_equal(seen.faults, 0);
	expect_good_end();
}

ZTEST(lsm6dsox_stream, test_missing_interrupt_is_reported_and_bridged)
{
	const struct lsm6dsox_stats stats = stream_with("missing_int:3:4");

	zexpect_true(stats.missed_edges >= 50);
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_NO_INTERRUPT);
	zexpect_equal(seen.faults, 1);
	zexpect_equal(seen.holes, 0);
	zexpect_true(seen.untimed > 20, "times without edges are not hardware times");
	zexpect_true(seen.untimed < seen.batches / 2);
	expect_good_end();
}

ZTEST(lsm6dsox_stream, test_streams_without_any_interrupt)
{
	const struct lsm6dsox_stats stats = stream_with("missing_int");

	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_NO_INTERRUPT);
	zexpect_true(stats.samples > 3000);
	zexpect_equal(seen.untimed, seen.batches);
	zexpect_equal(seen.holes, 0);
}

ZTEST(lsm6dsox_stream, test_overrun_is_counted_and_numbered_right)
{
	const struct lsm6dsox_stats stats = stream_with("overrun:3");

	zexpect_equal(stats.overruns, 1);
	zexpect_equal(stats.restarts, 0);
	zexpect_equal(seen.holes, 1);
	zexpect_between_inclusive(seen.missing, 28, 48);
	zexpect_equal(seen.missing, stats.fifo.slots_lost);
	zexpect_equal(seen.overrun_flags, 1);
	zexpect_true(seen.longest_silence_us < 1000000);
	expect_good_end();
}

ZTEST(lsm6dsox_stream, test_overruns_at_the_top_rate)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_model_set_faults("overrun:3:4:2");
	start(6667);
	k_sleep(K_SECONDS(10));
	stats = stop();
	report("overruns at 6667 Hz", &stats);
	expect_sound_samples();
	zexpect_equal(stats.overruns, 8);
	zexpect_equal(seen.holes, 8);
	zexpect_equal(seen.missing, stats.fifo.slots_lost);
	expect_good_end();
}

static void check_bit_errors(uint16_t rate_hz, const char *fault)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_model_set_faults(fault);
	start(rate_hz);
	k_sleep(K_SECONDS(10));
	stats = stop();
	report(fault, &stats);
	/* Data bytes carry no check, so a flipped bit there cannot be told from motion: of the
	 * samples only number and time are checked here.
	 */
	zexpect_true(stats.fifo.parity_errors > 10);
	zexpect_true(seen.worst_us <= TOLERANCE_US, "%.2f us off", seen.worst_us);
	zexpect_true(stats.fifo.slots_lost >= stats.fifo.parity_errors / 2);
	zexpect_equal(seen.missing, stats.fifo.slots_lost);
	zexpect_equal(stats.restarts, 0);
	zexpect_true(seen.longest_silence_us < 1000000);
	expect_good_end();
}

ZTEST(lsm6dsox_stream, test_bit_errors_cost_samples_but_make_none)
{
	check_bit_errors(417, "bit_errors:3:4:1e-3");
}

ZTEST(lsm6dsox_stream, test_bit_errors_at_the_top_rate)
{
	check_bit_errors(6667, "bit_errors:3:4:1e-4");
}

static void check_stuck_bus(const char *fault)
{
	const struct lsm6dsox_stats stats = stream_with(fault);

	zexpect_true(stats.bus_errors > 0);
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_BUS);
	zexpect_equal(seen.faults, 1);
	/* Two seconds of it, less what was on its way, and a second to recover in. */
	zexpect_between_inclusive(seen.longest_silence_us, 1900000, 3000000);
	zexpect_equal(seen.missing, stats.fifo.slots_lost);
	expect_good_end();
}

ZTEST(lsm6dsox_stream, test_bus_stuck_high)
{
	check_stuck_bus("stuck_bus:3:2:1");
}

ZTEST(lsm6dsox_stream, test_bus_stuck_low)
{
	check_stuck_bus("stuck_bus:3:2:0");
}

ZTEST(lsm6dsox_stream, test_wrong_who_am_i_is_a_fault_that_names_the_wiring)
{
	lsm6dsox_model_set_faults("wrong_who_am_i:0:3");
	start(417);
	k_sleep(K_SECONDS(2));
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_WHO_AM_I);
	zexpect_equal(seen.fault_argument, 0x6A);
	zexpect_equal(seen.faults, 1, "one report per outage");
	zexpect_not_null(strstr(seen.fault_detail, "MISO"), "'%s'", seen.fault_detail);
	zexpect_equal(seen.batches, 0);
	k_sleep(K_SECONDS(2));
	zexpect_true(seen.samples > 200, "it works within a second of the chip's return");
	(void)stop();
}

ZTEST(lsm6dsox_stream, test_silent_chip_is_a_fault_that_names_the_wiring)
{
	lsm6dsox_model_set_faults("stuck_bus:0:3:1");
	start(417);
	k_sleep(K_SECONDS(2));
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_WHO_AM_I);
	zexpect_equal(seen.fault_argument, 0xFF);
	zexpect_not_null(strstr(seen.fault_detail, "CS"), "'%s'", seen.fault_detail);
	k_sleep(K_SECONDS(2));
	zexpect_true(seen.samples > 200);
	(void)stop();
}

ZTEST(lsm6dsox_stream, test_a_chip_that_lost_its_supply_is_set_up_again)
{
	struct lsm6dsox_stats stats;

	start(417);
	k_sleep(K_SECONDS(3));
	lsm6dsox_model_power_cycle();
	k_sleep(K_SECONDS(3));
	stats = stop();
	report("power cycle", &stats);
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_FIFO_CONFIG);
	zexpect_equal(seen.faults, 1);
	zexpect_not_null(strstr(seen.fault_detail, "supply"), "'%s'", seen.fault_detail);
	zexpect_equal(stats.restarts, 1);
	zexpect_equal(seen.holes, 1, "the index shows that samples are missing");
	zexpect_true(seen.longest_silence_us < 1000000);
	zexpect_true(lsm6dsox_model_now_us() - seen.last_delivery_us < 200000);
}

/* --- rest ------------------------------------------------------------------------------------ */

static const double still[3] = {0.0, 0.0, 9.80665};
static const double lifted[3] = {0.0, 3.0, 11.0};
static const double calm[3];

static void start_with_rest(void)
{
	struct lsm6dsox_options options;

	lsm6dsox_model_set_pattern(false);
	lsm6dsox_model_set_motion(still, calm);
	lsm6dsox_default_options(imu, &options);
	options.rate_hz = 417;
	options.rest_s = 2;
	memset(&seen, 0, sizeof(seen));
	zassert_ok(lsm6dsox_start(imu, &options, &callbacks));
}

ZTEST(lsm6dsox_stream, test_wakes_without_an_interrupt_line)
{
	struct lsm6dsox_stats stats;
	uint32_t samples;

	start_with_rest();
	k_sleep(K_SECONDS(4));
	samples = seen.samples;
	lsm6dsox_model_set_faults("missing_int:0:3");
	lsm6dsox_model_set_motion(lifted, calm);
	k_sleep(K_SECONDS(5));
	stats = stop();
	zexpect_equal(stats.wake_ups, 1, "%u", stats.wake_ups);
	zexpect_equal(seen.fault, WIRE_FAULT_CODE_IMU_NO_INTERRUPT);
	zexpect_true(stats.missed_edges > 0);
	zexpect_true(seen.samples > samples + 400);
}

ZTEST(lsm6dsox_stream, test_a_fast_chip_does_not_wake_itself)
{
	struct lsm6dsox_stats stats;

	lsm6dsox_model_set_clock(0.08, 0.0);
	start_with_rest();
	k_sleep(K_SECONDS(8));
	stats = stop();
	zexpect_equal(stats.wake_ups, 0, "nothing moved, %u wake-ups", stats.wake_ups);
	zexpect_true(stats.samples < 1100, "it streams although it rests");
}

ZTEST(lsm6dsox_stream, test_stops_while_at_rest)
{
	struct lsm6dsox_stats stats;

	start_with_rest();
	k_sleep(K_SECONDS(4));
	stats = stop();
	zexpect_between_inclusive(stats.samples, 700, 1000);
	zexpect_equal(stats.wake_ups, 0, "nothing moved");
	zexpect_equal(seen.faults, 0);
}

ZTEST(lsm6dsox_stream, test_rests_when_still_and_wakes_when_moved)
{
	struct lsm6dsox_stats stats;
	uint32_t samples;
	uint32_t next_index;

	start_with_rest();
	k_sleep(K_SECONDS(4));
	samples = seen.samples;
	zexpect_between_inclusive(samples, 700, 1000);
	k_sleep(K_SECONDS(4));
	zexpect_equal(seen.samples, samples, "it streams although it rests");
	next_index = seen.next_index;
	lsm6dsox_model_set_motion(lifted, calm);
	k_sleep(K_SECONDS(1));
	stats = stop();
	zexpect_equal(stats.wake_ups, 1);
	zexpect_true(seen.samples > samples + 200);
	zexpect_equal(seen.holes, 0, "rest loses no samples: the index goes on from %u",
		      next_index);
	zexpect_between_inclusive(stats.wake_to_sample_us, 50000, 400000);
	zexpect_equal(seen.faults, 0);
	TC_PRINT("first sample %u us after the edge that woke it\n", stats.wake_to_sample_us);
}
