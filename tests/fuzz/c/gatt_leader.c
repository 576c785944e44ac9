/* SPDX-License-Identifier: Apache-2.0 */
/* The leader's sources, whole, so that their state can be put back to that after boot. */
#include "node_parts.h"

#define CONFIG_BV_LINK_LATE_MS      100
#define CONFIG_BV_SYNC_WANDER_PPB   200
#define CONFIG_BV_SYNC_WINDOW_MS    2000
#define CONFIG_BV_SYNC_HOLDOVER_MS  3000
#define CONFIG_BV_FAULT_SKEW_SIGN   0
#define main                        leader_main

#include "follower_stream.c"
#include "sync_task.c"
/* Two files, one name. */
#define same_clock leader_same_clock
#include "main.c"

void leader_reset(void)
{
	k_msgq_purge(&items);
	params = sync_estimator_params_default();
	params.wander_per_sqrt_s = CONFIG_BV_SYNC_WANDER_PPB * 1e-9;
	params.window_ticks = (uint64_t)CONFIG_BV_SYNC_WINDOW_MS * TICKS_PER_MS;
	params.holdover_max_ticks = (uint64_t)CONFIG_BV_SYNC_HOLDOVER_MS * TICKS_PER_MS;
	memset(&pairing, 0, sizeof(pairing));
	memset(&estimator, 0, sizeof(estimator));
	generation = 0;
	confirmed = false;
	memset(&published, 0, sizeof(published));
	memset(&published_model, 0, sizeof(published_model));
	published_confirmed = false;
	received = 0;
	lost = 0;
	late = 0;
	next_index = 0;
}

void leader_connect(void)
{
	on_connected(0, true);
}

bool leader_receive(uint8_t type, const uint8_t *payload, size_t len)
{
	return on_message(type, payload, len);
}

void leader_capture(const struct sync_capture *capture)
{
	sync_task_own_capture(capture);
}

void leader_batch(const struct wire_imu_batch *batch)
{
	on_batch(batch);
}

void leader_threads(void)
{
	struct wire_link_stats stats;
	struct item item;

	while (k_msgq_get(&items, &item, K_NO_WAIT) == 0) {
		take(&item);
	}
	publish(sync_timer_now_ticks());
	every_second();
	follower_stream_stats(&stats);
}
