/* SPDX-License-Identifier: Apache-2.0 */
#include "imu_decimate.h"

#include <stddef.h>
#include <string.h>

/* Between the stages counts keep this many fractional bits. */
#define FRACTION_BITS 8

/* A half-band filter: the centre weighs one half, each second tap nothing, and the others, at odd
 * distances 1, 3, 5 ... on both sides, as given, in units of 2^-15.
 */
struct half_band {
	uint32_t centre;
	int32_t side[6];
};

static const struct half_band early = {3, {9268, -1076}};
static const struct half_band middle = {5, {9743, -1831, 280}};
static const struct half_band last = {11, {10271, -3010, 1389, -645, 269, -82}};

static const struct half_band *filter_of(const struct imu_decimate *d, uint32_t stage)
{
	const uint32_t stages_behind = d->stages - 1U - stage;

	return stages_behind == 0U ? &last : stages_behind == 1U ? &middle : &early;
}

void imu_decimate_init(struct imu_decimate *d, uint32_t factor, uint8_t batch_samples)
{
	memset(d, 0, sizeof(*d));
	while (factor >= 2U && d->stages < IMU_DECIMATE_STAGES_MAX) {
		factor /= 2U;
		d->stages++;
	}
	d->batch_samples = batch_samples;
}

static const int32_t *tap(const struct imu_decimate_stage *s, uint32_t age)
{
	return s->line[(s->at + IMU_DECIMATE_TAPS_MAX - age) % IMU_DECIMATE_TAPS_MAX];
}

static void convolve(const struct imu_decimate_stage *s, const struct half_band *f,
		     int32_t out[IMU_DECIMATE_AXES])
{
	for (size_t axis = 0; axis < IMU_DECIMATE_AXES; axis++) {
		int64_t sum = (int64_t)tap(s, f->centre)[axis] * (1 << 14);

		for (uint32_t i = 0; 2U * i + 1U <= f->centre; i++) {
			const uint32_t distance = 2U * i + 1U;

			sum += (int64_t)f->side[i] * (tap(s, f->centre - distance)[axis] +
						      tap(s, f->centre + distance)[axis]);
		}
		out[axis] = (int32_t)((sum + (1 << 14)) >> 15);
	}
}

/*
 * Give one sample to a stage.
 *
 * @return whether one comes out: when the sample at the filter's centre has an even index.
 */
static bool push_stage(struct imu_decimate_stage *s, const struct half_band *f, uint32_t *index,
		       int32_t sample[IMU_DECIMATE_AXES])
{
	const uint32_t centre_index = *index - f->centre;

	if (*index != s->next_index) {
		s->filled = 0;
	}
	s->next_index = *index + 1U;
	s->at = (s->at + 1U) % IMU_DECIMATE_TAPS_MAX;
	memcpy(s->line[s->at], sample, sizeof(s->line[0]));
	s->filled += s->filled <= 2U * f->centre ? 1U : 0U;
	if (s->filled <= 2U * f->centre || centre_index % 2U != 0U) {
		return false;
	}
	convolve(s, f, sample);
	*index = centre_index / 2U;
	return true;
}

static int16_t to_counts(int32_t value)
{
	const int32_t counts = (value + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS;

	return (int16_t)(counts > INT16_MAX ? INT16_MAX : counts < INT16_MIN ? INT16_MIN : counts);
}

static void flush(struct imu_decimate *d, imu_decimate_out out, void *context)
{
	if (d->pending.count > 0U) {
		out(context, &d->pending);
		d->pending.count = 0;
	}
}

/* Time of the input's sample @p index, by the batch that is being taken. */
static uint64_t time_of(const struct wire_imu_batch *batch, uint32_t index)
{
	const int64_t since_q8 =
		(int64_t)(int32_t)(index - batch->sample_index) * batch->period_ticks;

	return batch->t_first_ticks_node + (uint64_t)((since_q8 + 128) >> 8);
}

static void begin_batch(struct imu_decimate *d, const struct wire_imu_batch *batch, uint32_t index)
{
	d->pending = *batch;
	d->pending.count = 0;
	d->pending.flags = d->sticky_flags | (batch->flags & WIRE_IMU_FLAG_HARDWARE_TIME);
	d->pending.sample_index = index;
	d->pending.t_first_ticks_node = time_of(batch, index << d->stages);
	d->pending.period_ticks = batch->period_ticks << d->stages;
	d->sticky_flags = 0;
}

static void put(struct imu_decimate *d, const struct wire_imu_batch *batch, uint32_t index,
		const int32_t sample[IMU_DECIMATE_AXES], imu_decimate_out out, void *context)
{
	struct wire_imu_batch_samples *put;

	if (d->pending.count == 0U) {
		begin_batch(d, batch, index);
	}
	put = &d->pending.samples[d->pending.count++];
	for (size_t axis = 0; axis < 3; axis++) {
		put->gyro_lsb[axis] = to_counts(sample[axis]);
		put->accel_lsb[axis] = to_counts(sample[3 + axis]);
	}
	if (d->pending.count >= d->batch_samples) {
		flush(d, out, context);
	}
}

void imu_decimate_push(struct imu_decimate *d, const struct wire_imu_batch *batch,
		       imu_decimate_out out, void *context)
{
	if (d->stages == 0U) {
		out(context, batch);
		return;
	}
	if (d->running && batch->sample_index != d->next_index) {
		flush(d, out, context);
	}
	d->running = true;
	d->next_index = batch->sample_index + batch->count;
	d->sticky_flags |= (uint8_t)(batch->flags & ~WIRE_IMU_FLAG_HARDWARE_TIME);
	for (uint32_t i = 0; i < batch->count; i++) {
		int32_t sample[IMU_DECIMATE_AXES];
		uint32_t index = batch->sample_index + i;
		uint32_t stage = 0;

		for (size_t axis = 0; axis < 3; axis++) {
			sample[axis] = batch->samples[i].gyro_lsb[axis] * (1 << FRACTION_BITS);
			sample[3 + axis] = batch->samples[i].accel_lsb[axis] * (1 << FRACTION_BITS);
		}
		while (stage < d->stages &&
		       push_stage(&d->stage[stage], filter_of(d, stage), &index, sample)) {
			stage++;
		}
		if (stage == d->stages) {
			put(d, batch, index, sample, out, context);
		}
	}
}
