/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Chip model and FIFO stream side by side, flat, for a bench written in Python: the test brings the
 * wires between them. Both keep what they did in arrays that the test reads.
 */
#include <stdlib.h>
#include <string.h>

#include "lsm6dsox_stream.h"
#include "model/chip.h"
#include "model/motion.h"

enum { SLOT_FIELDS = 10, SAMPLE_FIELDS = 10 };

struct log {
	double *rows;
	size_t count;
	size_t capacity;
	size_t fields;
};

struct shim {
	struct chip *chip;
	struct lsm6dsox_stream stream;
	struct motion *motion;
	struct log slots;   /* run, slot, t_us_true, gyro xyz, accel xyz, flags */
	struct log samples; /* index, t ticks of its batch, place in it, flags, gyro xyz, accel xyz */
	struct log batches; /* index, t ticks, count, flags, period ticks * 256 */
	char violation[200];
	int violations;
};

static void put(struct log *log, const double *row)
{
	if (log->count == log->capacity) {
		log->capacity = log->capacity == 0 ? 1024 : 2 * log->capacity;
		log->rows = realloc(log->rows, log->capacity * log->fields * sizeof(double));
		if (log->rows == NULL) {
			abort();
		}
	}
	memcpy(&log->rows[log->count++ * log->fields], row, log->fields * sizeof(double));
}

static void on_slot(void *context, const struct chip_slot *s)
{
	struct shim *shim = context;
	const double row[SLOT_FIELDS] = {
		s->run,           s->slot,          (double)s->t_us_true, s->gyro_lsb[0],
		s->gyro_lsb[1],   s->gyro_lsb[2],   s->accel_lsb[0],      s->accel_lsb[1],
		s->accel_lsb[2],  s->flags,
	};

	put(&shim->slots, row);
}

static void on_violation(void *context, const char *text)
{
	struct shim *shim = context;

	shim->violations++;
	strncpy(shim->violation, text, sizeof(shim->violation) - 1);
}

static void on_motion(void *context, long double t_us_true, struct chip_motion *at)
{
	struct shim *shim = context;

	if (shim->motion != NULL) {
		motion_at(shim->motion, (double)(t_us_true * 1e-6L), at);
	}
}

static void on_batch(void *context, const struct wire_imu_batch *b)
{
	struct shim *shim = context;
	const double batch[] = {b->sample_index, (double)b->t_first_ticks_node, b->count, b->flags,
				b->period_ticks};

	put(&shim->batches, batch);
	for (int i = 0; i < b->count; i++) {
		const struct wire_imu_batch_samples *s = &b->samples[i];
		const double row[SAMPLE_FIELDS] = {
			b->sample_index + (double)i, (double)b->t_first_ticks_node, i, b->flags,
			s->gyro_lsb[0],              s->gyro_lsb[1],                s->gyro_lsb[2],
			s->accel_lsb[0],             s->accel_lsb[1],               s->accel_lsb[2],
		};

		put(&shim->samples, row);
	}
}

struct shim *shim_new(double rate_error, double rate_drift_per_s, int pattern,
		      const char *motion_file, char *problem, size_t problem_size)
{
	struct shim *shim = calloc(1, sizeof(*shim));
	const struct chip_config config = {
		.rate_error = rate_error,
		.rate_drift_per_s = rate_drift_per_s,
		.temperature_degc = 25.0,
		.gyro_turn_on_us = 70000.0,
		.accel_turn_on_us = 20000.0,
		.pattern = pattern != 0,
		.context = shim,
		.motion = on_motion,
		.slot = on_slot,
		.violation = on_violation,
	};

	shim->slots.fields = SLOT_FIELDS;
	shim->samples.fields = SAMPLE_FIELDS;
	shim->batches.fields = 5;
	shim->chip = chip_new(&config);
	if (motion_file != NULL) {
		shim->motion = motion_load(motion_file, problem, problem_size);
	}
	return shim;
}

void shim_free(struct shim *shim)
{
	chip_free(shim->chip);
	motion_free(shim->motion);
	free(shim->slots.rows);
	free(shim->samples.rows);
	free(shim->batches.rows);
	free(shim);
}

int shim_has_motion(const struct shim *shim)
{
	return shim->motion != NULL;
}

void shim_stream_init(struct shim *shim, double nominal_rate_hz, unsigned int batch_samples,
		      unsigned int edge_latency_ticks)
{
	const struct lsm6dsox_stream_params params = {
		.nominal_rate_hz = (float)nominal_rate_hz,
		.timing = lsm6dsox_timing_defaults(),
		.edge_latency_ticks = edge_latency_ticks,
		.watermark_words = (uint16_t)(2U * batch_samples),
		.batch_samples = (uint8_t)batch_samples,
		.settling_slots = (uint32_t)(0.08 * nominal_rate_hz),
		.accel_fs_g = 16,
		.gyro_fs_dps = 2000,
		.context = shim,
		.on_batch = on_batch,
	};

	lsm6dsox_stream_init(&shim->stream, &params);
}

void shim_advance(struct shim *shim, double t_us)
{
	chip_advance(shim->chip, t_us);
}

double shim_next_us(const struct shim *shim)
{
	return (double)chip_next_us(shim->chip);
}

int shim_int1(const struct shim *shim)
{
	return chip_int1(shim->chip);
}

/* One transfer of n bytes beginning at t_us, byte_us each. @return when it ends. */
double shim_transfer(struct shim *shim, double t_us, double byte_us, const uint8_t *mosi,
		     uint8_t *miso, size_t n)
{
	chip_select(shim->chip);
	for (size_t i = 0; i < n; i++) {
		chip_advance(shim->chip, t_us);
		miso[i] = chip_exchange(shim->chip, mosi[i]);
		t_us += byte_us;
	}
	chip_deselect(shim->chip);
	return t_us;
}

void shim_edge(struct shim *shim, uint64_t ticks)
{
	lsm6dsox_stream_edge(&shim->stream, ticks);
}

void shim_gap(struct shim *shim, int overrun)
{
	lsm6dsox_stream_gap(&shim->stream, overrun != 0);
}

void shim_words(struct shim *shim, const uint8_t *words, size_t size)
{
	lsm6dsox_stream_words(&shim->stream, words, size);
}

void shim_end(struct shim *shim, uint64_t status_ticks, int polled)
{
	lsm6dsox_stream_end(&shim->stream, status_ticks, polled != 0);
}

void shim_restarted(struct shim *shim, uint64_t now_ticks, int count_missing)
{
	lsm6dsox_stream_restarted(&shim->stream, now_ticks, count_missing != 0);
}

void shim_flush(struct shim *shim)
{
	lsm6dsox_stream_flush(&shim->stream);
}

static const struct log *log_of(const struct shim *shim, int which)
{
	return which == 0 ? &shim->slots : which == 1 ? &shim->samples : &shim->batches;
}

size_t shim_rows(const struct shim *shim, int which)
{
	return log_of(shim, which)->count;
}

void shim_copy(const struct shim *shim, int which, double *rows)
{
	const struct log *log = log_of(shim, which);

	if (log->count > 0) {
		memcpy(rows, log->rows, log->count * log->fields * sizeof(double));
	}
}

int shim_violations(const struct shim *shim, char *text, size_t size)
{
	strncpy(text, shim->violation, size - 1);
	return shim->violations;
}

/* samples, crc32, unsettled, resolved by time, slots lost, pairs, edges refused */
void shim_counters(const struct shim *shim, int64_t values[7])
{
	const struct lsm6dsox_stream *s = &shim->stream;

	values[0] = s->counters.samples;
	values[1] = s->counters.samples_crc32;
	values[2] = s->counters.pairs_unsettled;
	values[3] = s->counters.slots_resolved_by_time;
	values[4] = s->decoder.counters.slots_lost;
	values[5] = s->decoder.counters.pairs;
	values[6] = s->timing.edges_refused;
}
