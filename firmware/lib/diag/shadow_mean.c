/* SPDX-License-Identifier: Apache-2.0 */
#include "shadow_mean.h"

#include <string.h>

#include "lsm6dsox_scale.h"

#define TICKS_PER_US (WIRE_TICK_RATE_HZ / 1000000U)

/* Units of a row in what the scale's whole numbers count in: 1e-12 m/s^2 and 1e-15 rad/s. */
#define ACCEL_PER_UNIT INT64_C(100000000)
#define GYRO_PER_UNIT  INT64_C(10000000000)

/* To the nearest, halves away from zero. */
static int32_t rounded(int64_t value, int64_t divisor)
{
	return (int32_t)((value + (value < 0 ? -divisor : divisor) / 2) / divisor);
}

static bool is_clipped(const struct wire_imu_batch_samples *sample)
{
	bool clipped = false;

	for (size_t i = 0; i < 3; i++) {
		clipped = clipped || sample->accel_lsb[i] >= LSM6DSOX_CLIPPED_LSB ||
			  sample->accel_lsb[i] <= -LSM6DSOX_CLIPPED_LSB ||
			  sample->gyro_lsb[i] >= LSM6DSOX_CLIPPED_LSB ||
			  sample->gyro_lsb[i] <= -LSM6DSOX_CLIPPED_LSB;
	}
	return clipped;
}

static void deliver(struct shadow_mean *m, shadow_mean_out out)
{
	struct shadow_row row = {
		.t_us = (m->t_first_ticks + m->t_last_ticks) / (2U * TICKS_PER_US),
		.flags = m->flags,
	};

	if (m->count == 0U) {
		return;
	}
	for (size_t i = 0; i < 3; i++) {
		row.accel[i] = rounded((int64_t)m->accel_lsb[i] * m->accel_fs_g *
					       LSM6DSOX_ACCEL_PMPS2_PER_LSB_PER_G,
				       ACCEL_PER_UNIT * m->count);
		row.gyro[i] = rounded((int64_t)m->gyro_lsb[i] * m->gyro_fs_dps *
					      LSM6DSOX_GYRO_FRADPS_PER_LSB_PER_DPS,
				      GYRO_PER_UNIT * m->count);
	}
	out(&row);
	m->count = 0;
}

static void begin(struct shadow_mean *m, uint64_t t_ticks)
{
	m->cell = t_ticks / (SHADOW_PERIOD_US * TICKS_PER_US);
	m->t_first_ticks = t_ticks;
	m->flags = 0;
	memset(m->accel_lsb, 0, sizeof(m->accel_lsb));
	memset(m->gyro_lsb, 0, sizeof(m->gyro_lsb));
}

static void add(struct shadow_mean *m, const struct wire_imu_batch_samples *sample,
		uint64_t t_ticks)
{
	m->count++;
	m->t_last_ticks = t_ticks;
	m->flags |= is_clipped(sample) ? SHADOW_CLIPPED : 0U;
	for (size_t i = 0; i < 3; i++) {
		m->accel_lsb[i] += sample->accel_lsb[i];
		m->gyro_lsb[i] += sample->gyro_lsb[i];
	}
}

void shadow_mean_push(struct shadow_mean *m, const struct wire_imu_batch *batch,
		      shadow_mean_out out)
{
	const bool gap = m->running && batch->sample_index != m->next_index;

	if (gap || batch->accel_fs_g != m->accel_fs_g || batch->gyro_fs_dps != m->gyro_fs_dps) {
		deliver(m, out);
	}
	m->accel_fs_g = batch->accel_fs_g;
	m->gyro_fs_dps = batch->gyro_fs_dps;
	for (uint32_t i = 0; i < batch->count; i++) {
		const uint64_t since_subticks = (uint64_t)i * batch->period_ticks;
		const uint64_t t_ticks =
			batch->t_first_ticks_node + ((since_subticks + 128U) >> 8);

		if (m->count > 0U && t_ticks / (SHADOW_PERIOD_US * TICKS_PER_US) != m->cell) {
			deliver(m, out);
		}
		if (m->count == 0U) {
			begin(m, t_ticks);
		}
		add(m, &batch->samples[i], t_ticks);
		m->flags |= gap && i == 0U ? SHADOW_GAP : 0U;
		m->flags |= (batch->flags & WIRE_IMU_FLAG_UNCORRECTED) != 0U ? SHADOW_UNCORRECTED : 0U;
	}
	m->next_index = batch->sample_index + batch->count;
	m->running = true;
}
