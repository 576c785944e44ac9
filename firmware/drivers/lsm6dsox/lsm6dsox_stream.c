/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_stream.h"

#include <string.h>

#include "lsm6dsox_scale.h"

/* With DRDY_MASK set, counts of a sensor that has not settled are 7FFDh or more on every axis
 * (ST AN5040, section 4.3.1, DRDY mask functionality).
 */
#define UNSETTLED_LSB 0x7FFD

/* Two intervals between edges give a period and a check of it. */
#define EDGES_TO_SETTLE 3U

/* A chip without a working interrupt is believed after this long all the same. */
#define SETTLING_MAX_S 0.5f

/* A batch counts as timed by hardware while three times this stays close to 1 us. Just after the
 * third edge it is 4.6 ticks, in steady state less.
 */
#define HARDWARE_SIGMA_TICKS 6.0f

static uint32_t crc32_nibbles(uint32_t crc, uint8_t byte)
{
	/* IEEE 802.3, reflected, four bits at a time. */
	static const uint32_t table[16] = {
		0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
		0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
		0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
	};

	crc = table[(crc ^ byte) & 0x0FU] ^ (crc >> 4);
	return table[(crc ^ (byte >> 4)) & 0x0FU] ^ (crc >> 4);
}

static uint32_t crc32_axes(uint32_t crc, const int16_t axes_lsb[3])
{
	for (size_t i = 0; i < 3; i++) {
		const uint16_t raw = (uint16_t)axes_lsb[i];

		crc = crc32_nibbles(crc, (uint8_t)(raw & 0xFFU));
		crc = crc32_nibbles(crc, (uint8_t)(raw >> 8));
	}
	return crc;
}

/* --- batches --------------------------------------------------------------------------------- */

static bool is_clipped(const int16_t axes_lsb[3])
{
	for (size_t i = 0; i < 3; i++) {
		if (axes_lsb[i] >= LSM6DSOX_CLIPPED_LSB || axes_lsb[i] <= -LSM6DSOX_CLIPPED_LSB) {
			return true;
		}
	}
	return false;
}

static void take_sample(struct lsm6dsox_stream *s, const struct lsm6dsox_pair *pair,
			struct wire_imu_batch *batch)
{
	struct wire_imu_batch_samples *sample = &batch->samples[batch->count++];
	uint32_t crc = ~s->counters.samples_crc32;

	memcpy(sample->gyro_lsb, pair->gyro_lsb, sizeof(sample->gyro_lsb));
	memcpy(sample->accel_lsb, pair->accel_lsb, sizeof(sample->accel_lsb));
	if (is_clipped(pair->gyro_lsb) || is_clipped(pair->accel_lsb)) {
		batch->flags |= WIRE_IMU_FLAG_CLIPPED;
	}
	crc = crc32_axes(crc, pair->gyro_lsb);
	crc = crc32_axes(crc, pair->accel_lsb);
	s->counters.samples_crc32 = ~crc;
	s->counters.samples++;
	s->resting = lsm6dsox_rest_push(&s->params.rest, pair);
}

static uint16_t sigma_subticks(float sigma_ticks)
{
	const float subticks = sigma_ticks * 256.0f;

	return subticks < (float)UINT16_MAX ? (uint16_t)subticks : UINT16_MAX;
}

static void deliver_batch(struct lsm6dsox_stream *s, const struct lsm6dsox_pair *pairs, size_t count)
{
	struct wire_imu_batch batch = {
		.accel_fs_g = s->params.accel_fs_g,
		.gyro_fs_dps = s->params.gyro_fs_dps,
		.period_ticks = lsm6dsox_timing_period_q8(&s->timing),
		.temperature_cdegc = s->temperature_cdegc,
	};
	const uint32_t slot = pairs[0].slot;
	const float sigma_ticks = lsm6dsox_timing_sigma_ticks(&s->timing, slot);

	if (s->rebase) {
		s->index_base += slot - s->next_slot;
		s->rebase = false;
	}
	batch.sample_index = slot - s->index_base;
	batch.t_first_ticks_node = lsm6dsox_timing_slot_ticks(&s->timing, slot);
	batch.t_sigma_ticks = sigma_subticks(sigma_ticks);
	if (s->timing.edges >= EDGES_TO_SETTLE && sigma_ticks < HARDWARE_SIGMA_TICKS) {
		batch.flags |= WIRE_IMU_FLAG_HARDWARE_TIME;
	}
	if (s->overrun) {
		batch.flags |= WIRE_IMU_FLAG_OVERRUN_BEFORE;
		s->overrun = false;
	}
	for (size_t i = 0; i < count; i++) {
		take_sample(s, &pairs[i], &batch);
	}
	s->next_slot = slot + (uint32_t)count;
	s->params.on_batch(s->params.context, &batch);
}

/* Length of the run of consecutive slots at the start of @p pairs, up to a batch. */
static size_t run_length(const struct lsm6dsox_stream *s, const struct lsm6dsox_pair *pairs,
			 size_t count)
{
	size_t run = 1;

	while (run < count && run < s->params.batch_samples &&
	       pairs[run].slot == pairs[0].slot + run) {
		run++;
	}
	return run;
}

/* Deliver whole batches; and, when @p all, also what is left. */
static void deliver(struct lsm6dsox_stream *s, bool all)
{
	size_t done = 0;

	while (done < s->count) {
		const size_t left = s->count - done;
		const size_t run = run_length(s, &s->pairs[done], left);

		/* A run that ends in a hole can grow no more. */
		if (run == left && run < s->params.batch_samples && !all) {
			break;
		}
		deliver_batch(s, &s->pairs[done], run);
		done += run;
	}
	s->count -= done;
	memmove(s->pairs, &s->pairs[done], s->count * sizeof(s->pairs[0]));
}

/* --- slots and time -------------------------------------------------------------------------- */

static int32_t nearest_multiple(int32_t value, int32_t of)
{
	return (value + (value >= 0 ? of / 2 : -of / 2)) / of * of;
}

/*
 * By time the slot called @p numbered is @p by_time: the difference, as far as the slot counter
 * leaves it open, is put right.
 */
static void resolve(struct lsm6dsox_stream *s, uint32_t numbered, uint32_t by_time)
{
	const int32_t missing =
		nearest_multiple((int32_t)(by_time - numbered), (int32_t)LSM6DSOX_SLOT_MODULUS);

	if (missing > 0) {
		lsm6dsox_decoder_skip(&s->decoder, (uint32_t)missing);
		for (size_t i = 0; i < s->count; i++) {
			s->pairs[i].slot += (uint32_t)missing;
		}
		s->mark_slot += (uint32_t)missing;
		s->counters.slots_resolved_by_time += (uint32_t)missing;
	} else if (missing < 0) {
		/* Numbers given out cannot be taken back: time follows them. */
		lsm6dsox_timing_renumber(&s->timing, -missing);
	}
}

/* Whether slot times are known well enough to tell slots apart that count alike. */
static bool can_tell_slots(const struct lsm6dsox_stream *s, uint32_t slot)
{
	return lsm6dsox_timing_has_phase(&s->timing) &&
	       lsm6dsox_timing_sigma_ticks(&s->timing, slot) <
		       lsm6dsox_timing_period_ticks(&s->timing) / 4.0f;
}

static void begin_settling(struct lsm6dsox_stream *s, uint32_t slots_min)
{
	s->settling = true;
	s->settling_slots = 0;
	s->settling_slots_min = slots_min;
}

static void close_gap(struct lsm6dsox_stream *s, uint64_t status_ticks)
{
	uint32_t newest;

	if (!lsm6dsox_decoder_newest(&s->decoder, &newest)) {
		return;
	}
	s->gap = false;
	if (can_tell_slots(s, newest)) {
		resolve(s, newest, lsm6dsox_timing_slot_at(&s->timing, status_ticks));
	} else {
		/* The sensors are settled, but nobody knows the time of a sample. */
		lsm6dsox_timing_lose_phase(&s->timing);
		begin_settling(s, 0U);
	}
}

static void use_edge(struct lsm6dsox_stream *s)
{
	const uint64_t slot_ticks = s->edge_ticks - s->params.edge_latency_ticks;
	const uint64_t half_period_ticks =
		(uint64_t)(lsm6dsox_timing_period_ticks(&s->timing) / 2.0f);

	if (s->timing.edges >= EDGES_TO_SETTLE && can_tell_slots(s, s->mark_slot)) {
		const uint32_t by_time =
			lsm6dsox_timing_slot_at(&s->timing, slot_ticks + half_period_ticks);

		if ((by_time - s->mark_slot) % LSM6DSOX_SLOT_MODULUS == 0U) {
			resolve(s, s->mark_slot, by_time);
		}
	}
	(void)lsm6dsox_timing_edge(&s->timing, s->mark_slot, slot_ticks);
}

/* --- settling -------------------------------------------------------------------------------- */

static bool is_unsettled(const int16_t axes_lsb[3])
{
	return axes_lsb[0] >= UNSETTLED_LSB && axes_lsb[1] >= UNSETTLED_LSB &&
	       axes_lsb[2] >= UNSETTLED_LSB;
}

static void drop_first(struct lsm6dsox_stream *s, size_t pairs)
{
	s->counters.pairs_unsettled += (uint32_t)pairs;
	s->settling_slots += (uint32_t)pairs;
	s->count -= pairs;
	memmove(s->pairs, &s->pairs[pairs], s->count * sizeof(s->pairs[0]));
}

/* Drop what was sampled before sensors and timing had settled. */
static void settle(struct lsm6dsox_stream *s)
{
	const bool is_late =
		(float)s->settling_slots > SETTLING_MAX_S * s->params.nominal_rate_hz;
	size_t unsettled = 0;

	if (s->settling_slots < s->settling_slots_min) {
		unsettled = s->settling_slots_min - s->settling_slots;
		unsettled = unsettled < s->count ? unsettled : s->count;
	}
	for (size_t i = unsettled; i < s->count; i++) {
		if (is_unsettled(s->pairs[i].gyro_lsb) || is_unsettled(s->pairs[i].accel_lsb)) {
			unsettled = i + 1U;
		}
	}
	if (is_late && lsm6dsox_timing_has_phase(&s->timing)) {
		s->settling = false;
		return;
	}
	if (s->timing.edges < EDGES_TO_SETTLE || unsettled == s->count) {
		drop_first(s, s->count);
		return;
	}
	drop_first(s, unsettled);
	s->settling = false;
}

/* --- calls of the driver --------------------------------------------------------------------- */

void lsm6dsox_stream_init(struct lsm6dsox_stream *s, const struct lsm6dsox_stream_params *params)
{
	memset(s, 0, sizeof(*s));
	s->params = *params;
	lsm6dsox_decoder_init(&s->decoder, 0U);
	lsm6dsox_timing_init(&s->timing, &params->timing, params->nominal_rate_hz);
	lsm6dsox_rest_reset(&s->params.rest);
	begin_settling(s, s->params.settling_slots);
	s->rebase = true;
}

void lsm6dsox_stream_set_rate(struct lsm6dsox_stream *s, float nominal_rate_hz)
{
	s->params.nominal_rate_hz = nominal_rate_hz;
	lsm6dsox_timing_init(&s->timing, &s->params.timing, nominal_rate_hz);
}

void lsm6dsox_stream_restarted(struct lsm6dsox_stream *s, uint64_t now_ticks, bool count_missing)
{
	uint32_t next_slot = s->decoder.next_slot;

	lsm6dsox_stream_flush(s);
	if (count_missing && lsm6dsox_timing_has_phase(&s->timing)) {
		next_slot = lsm6dsox_timing_slot_at(&s->timing, now_ticks) + 1U;
	}
	lsm6dsox_decoder_restart(&s->decoder, next_slot);
	lsm6dsox_timing_lose_phase(&s->timing);
	lsm6dsox_rest_reset(&s->params.rest);
	s->resting = false;
	s->gap = false;
	s->words_to_mark = 0;
	begin_settling(s, s->params.settling_slots);
	s->rebase = s->rebase || !count_missing;
}

void lsm6dsox_stream_gap(struct lsm6dsox_stream *s, bool overrun)
{
	/* What waits was sampled before the gap and must not be renumbered with what follows. */
	deliver(s, true);
	lsm6dsox_decoder_break(&s->decoder);
	s->gap = true;
	s->overrun = s->overrun || overrun;
	s->words_to_mark = 0;
}

void lsm6dsox_stream_edge(struct lsm6dsox_stream *s, uint64_t edge_ticks)
{
	s->edge_ticks = edge_ticks;
	s->words_to_mark = s->params.watermark_words;
}

void lsm6dsox_stream_words(struct lsm6dsox_stream *s, const uint8_t *words, size_t size)
{
	const struct lsm6dsox_burst burst = lsm6dsox_decoder_push(
		&s->decoder, words, size, s->words_to_mark, &s->pairs[s->count]);

	s->count += burst.pairs;
	if (s->words_to_mark != 0U && burst.words >= s->words_to_mark) {
		s->mark_found = burst.mark_found;
		s->mark_slot = burst.mark_slot;
		s->words_to_mark = 0;
	} else if (s->words_to_mark != 0U) {
		s->words_to_mark -= burst.words;
	}
}

void lsm6dsox_stream_end(struct lsm6dsox_stream *s, uint64_t status_ticks, bool polled)
{
	uint32_t newest;

	if (s->gap) {
		close_gap(s, status_ticks);
	}
	if (s->mark_found) {
		use_edge(s);
		s->mark_found = false;
	} else if (polled && lsm6dsox_decoder_newest(&s->decoder, &newest)) {
		lsm6dsox_timing_newest(&s->timing, newest, status_ticks);
	}
	if (s->settling) {
		settle(s);
	}
	if (!s->settling) {
		deliver(s, false);
	}
}

void lsm6dsox_stream_flush(struct lsm6dsox_stream *s)
{
	if (s->settling) {
		drop_first(s, s->count);
	} else {
		deliver(s, true);
	}
}
