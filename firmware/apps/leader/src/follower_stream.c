/* SPDX-License-Identifier: Apache-2.0 */
#include "follower_stream.h"

#include <zephyr/kernel.h>

#include "node.h"
#include "sync_math.h"
#include "sync_task.h"
#include "sync_timer.h"

#define LATE_TICKS ((uint64_t)CONFIG_BV_LINK_LATE_MS * 1000U * SYNC_TICKS_PER_US)

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

static void convert(const struct sync_model *model, struct wire_imu_batch *batch)
{
	batch->t_first_ticks_node = sync_model_to_leader(model, batch->t_first_ticks_node);
	batch->period_ticks = sync_model_period_to_leader(model, batch->period_ticks);
}

static void count_late(const struct wire_imu_batch *batch)
{
	uint64_t last_ticks = batch->t_first_ticks_node +
			      (uint64_t)(batch->count - 1U) * batch->period_ticks /
				      SYNC_SUBTICKS_PER_TICK;

	if (sync_timer_now_ticks() > last_ticks + LATE_TICKS) {
		late++;
	}
}

bool follower_stream_take(const uint8_t *payload, size_t len)
{
	/* Too large for the stack of the Bluetooth RX thread, the only caller. */
	static struct wire_imu_batch batch;
	struct sync_model model;

	if (!wire_imu_batch_get(&batch, payload, len) || batch.count == 0U ||
	    batch.source != WIRE_ROLE_FOLLOWER) {
		return false;
	}
	count_gap(&batch);
	/* Without a model its times mean nothing here; the sample index shows the gap. */
	if (sync_task_model(&model)) {
		convert(&model, &batch);
		count_late(&batch);
		node_send_batch(&batch);
	}
	return true;
}

void follower_stream_stats(struct wire_link_stats *stats)
{
	stats->batches_received = received;
	stats->batches_lost = lost;
	stats->batches_late = late;
}
