/* SPDX-License-Identifier: Apache-2.0 */
#include "follower_stream.h"

#include <zephyr/kernel.h>

#include "fusion_task.h"
#include "sync_math.h"
#include "sync_task.h"
#include "sync_timer.h"

#define TICKS_PER_MS ((int64_t)SYNC_TICKS_PER_US * 1000)

#define LATE_TICKS (CONFIG_BV_LINK_LATE_MS * TICKS_PER_MS)
/* Room for the error of the clock model. */
#define FUTURE_TICKS (1 * TICKS_PER_MS)
#define PAST_TICKS   (60000 * TICKS_PER_MS)

/* 8 kHz and 11 Hz: the sensor's 6.67 kHz and 12.5 Hz, each off by less than a tenth. */
#define PERIOD_MIN_SUBTICKS (SYNC_TICK_RATE_HZ / 8000U * SYNC_SUBTICKS_PER_TICK)
#define PERIOD_MAX_SUBTICKS (SYNC_TICK_RATE_HZ / 11U * SYNC_SUBTICKS_PER_TICK)

/* Written by the Bluetooth RX thread alone; each is one word, so readers need no lock. */
static uint32_t received;
static uint32_t lost;
static uint32_t late;
static uint32_t next_index;

static void count_gap(const struct wire_imu_batch *batch)
{
	/* A smaller index is a follower that has started over, not a loss. */
	if (received > 0U && batch->sample_index > next_index) {
		lost++;
	}
	next_index = batch->sample_index + batch->count;
	received++;
}

/* What the clock model adds to the follower's own uncertainty, the larger of both at least. */
static uint16_t sigma_at_leader(uint16_t own_subticks)
{
	struct wire_sync_state state;
	uint64_t square;
	uint32_t root = 0;

	sync_task_last_state(&state);
	square = (uint64_t)own_subticks * own_subticks +
		 (uint64_t)MIN(state.offset_sigma_ticks, UINT16_MAX) *
			 MIN(state.offset_sigma_ticks, UINT16_MAX);
	/* Bit by bit: there is no 64-bit root without the floating-point library. */
	for (uint32_t bit = 1U << 16; bit != 0U; bit >>= 1) {
		const uint64_t larger = root | bit;

		root = larger * larger <= square ? (uint32_t)larger : root;
	}
	return (uint16_t)MIN(root, UINT16_MAX);
}

static void convert(const struct sync_model *model, struct wire_imu_batch *batch)
{
	batch->t_sigma_ticks = sigma_at_leader(batch->t_sigma_ticks);
	batch->t_first_ticks_node = sync_model_to_leader(model, batch->t_first_ticks_node);
	batch->period_ticks = sync_model_period_to_leader(model, batch->period_ticks);
}

/* Age of the batch's last sample, in ticks. Negative is a sample from the future. */
static int64_t age_ticks(const struct wire_imu_batch *batch)
{
	uint64_t last_ticks = batch->t_first_ticks_node +
			      (uint64_t)(batch->count - 1U) * batch->period_ticks /
				      SYNC_SUBTICKS_PER_TICK;

	return (int64_t)(sync_timer_now_ticks() - last_ticks);
}

/* What a sensor of this kind can have been set to. The peer may say anything, and a period beyond
 * the slowest rate would leave 32 bits on the leader's clock.
 */
static bool is_plausible(const struct wire_imu_batch *batch)
{
	const uint16_t g = batch->accel_fs_g;
	const uint16_t dps = batch->gyro_fs_dps;

	return (g == 2U || g == 4U || g == 8U || g == 16U) &&
	       (dps == 125U || dps == 250U || dps == 500U || dps == 1000U || dps == 2000U) &&
	       batch->period_ticks >= PERIOD_MIN_SUBTICKS &&
	       batch->period_ticks <= PERIOD_MAX_SUBTICKS;
}

/* Nothing is sampled after it has arrived, and nothing older than the supervision timeout and the
 * queue together can still come.
 */
static bool is_possible(const struct wire_imu_batch *batch)
{
	int64_t age = age_ticks(batch);

	return age > -FUTURE_TICKS && age < PAST_TICKS;
}

bool follower_stream_take(const uint8_t *payload, size_t len)
{
	/* Too large for the stack of the Bluetooth RX thread, the only caller. */
	static struct wire_imu_batch batch;
	struct sync_model model;

	if (!wire_imu_batch_get(&batch, payload, len) || batch.count == 0U ||
	    batch.source != WIRE_ROLE_FOLLOWER || !is_plausible(&batch)) {
		return false;
	}
	/* Without a model its times mean nothing here; the sample index shows the gap. */
	if (sync_task_model(&model)) {
		convert(&model, &batch);
		if (!is_possible(&batch)) {
			return false;
		}
		late += age_ticks(&batch) > LATE_TICKS ? 1U : 0U;
		fusion_take(&batch);
	}
	count_gap(&batch);
	return true;
}

void follower_stream_stats(struct wire_link_stats *stats)
{
	stats->batches_received = received;
	stats->batches_lost = lost;
	stats->batches_late = late;
}
