/* SPDX-License-Identifier: Apache-2.0 */
/* A flat interface to the decimator, so that ctypes needs no copy of its structures. */
#include <stdlib.h>
#include <string.h>

#include "imu_decimate.h"

enum { ROW = 11 }; /* index, t ticks, period, flags, place in the batch, gyro xyz, accel xyz */

struct shim {
	struct imu_decimate decimate;
	double *rows;
	size_t count;
	size_t capacity;
};

struct shim *shim_new(uint32_t factor, uint8_t batch_samples)
{
	struct shim *s = calloc(1, sizeof(*s));

	imu_decimate_init(&s->decimate, factor, batch_samples);
	return s;
}

void shim_free(struct shim *s)
{
	free(s->rows);
	free(s);
}

static void on_batch(void *context, const struct wire_imu_batch *b)
{
	struct shim *s = context;

	for (uint32_t i = 0; i < b->count; i++) {
		double *row;

		if (s->count == s->capacity) {
			s->capacity = s->capacity == 0 ? 1024 : 2 * s->capacity;
			s->rows = realloc(s->rows, s->capacity * ROW * sizeof(double));
		}
		row = &s->rows[s->count++ * ROW];
		row[0] = b->sample_index + i;
		row[1] = (double)b->t_first_ticks_node;
		row[2] = b->period_ticks;
		row[3] = b->flags;
		row[4] = i;
		for (int axis = 0; axis < 3; axis++) {
			row[5 + axis] = b->samples[i].gyro_lsb[axis];
			row[8 + axis] = b->samples[i].accel_lsb[axis];
		}
	}
}

/* samples: rows of gyro xyz, accel xyz; at most 16. */
void shim_push(struct shim *s, uint32_t index, uint64_t t_ticks, uint32_t period, uint8_t flags,
	       const int16_t *samples, uint8_t count)
{
	struct wire_imu_batch batch = {
		.sample_index = index,
		.t_first_ticks_node = t_ticks,
		.period_ticks = period,
		.flags = flags,
		.count = count,
		.accel_fs_g = 16,
		.gyro_fs_dps = 2000,
	};

	for (int i = 0; i < count; i++) {
		memcpy(batch.samples[i].gyro_lsb, samples + 6 * i, 6);
		memcpy(batch.samples[i].accel_lsb, samples + 6 * i + 3, 6);
	}
	imu_decimate_push(&s->decimate, &batch, on_batch, s);
}

size_t shim_rows(const struct shim *s)
{
	return s->count;
}

void shim_copy(const struct shim *s, double *rows)
{
	if (s->count > 0) {
		memcpy(rows, s->rows, s->count * ROW * sizeof(double));
	}
}
