/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Leader: owns the common clock. Ties the follower's clock to it, passes the follower's IMU
 * batches on with times on it, and raises pulses at the instants of its own schedule.
 */
#include <zephyr/kernel.h>

#include "diag_csv.h"
#include "follower_stream.h"
#include "fusion_task.h"
#include "link.h"
#include "node.h"
#include "peer.h"
#include "sync_ppi.h"
#include "sync_pulse.h"
#include "sync_task.h"
#include "sync_wire.h"

static bool same_clock(uint64_t t_ticks, uint64_t *out_ticks)
{
	*out_ticks = t_ticks;
	return true;
}

static void on_batch(const struct wire_imu_batch *batch)
{
	struct wire_imu_batch own = *batch;

	own.source = WIRE_ROLE_LEADER;
	fusion_take(&own);
	diag_csv_imu(&own);
}

static void on_connected(uint16_t handle, bool central)
{
	peer_begin();
	sync_task_connection_begin();
	sync_ppi_connection_begin(handle, central);
}

static bool take_capture(const uint8_t *payload, size_t len)
{
	struct wire_sync_capture message;
	struct sync_capture capture;

	if (!wire_sync_capture_get(&message, payload, len)) {
		return false;
	}
	sync_wire_to_capture(&message, &capture);
	sync_task_peer_capture(&capture);
	return true;
}

static bool on_message(uint8_t type, const uint8_t *payload, size_t len)
{
	switch (type) {
	case WIRE_HELLO_ID:
		return peer_take_hello(payload, len);
	case WIRE_SYNC_CAPTURE_ID:
		return peer_compatible() && take_capture(payload, len);
	case WIRE_IMU_BATCH_ID:
		return peer_compatible() && follower_stream_take(payload, len);
	default:
		return false;
	}
}

static void every_second(void)
{
	struct wire_sync_state state;

	sync_task_last_state(&state);
	diag_csv_sync(&state);
}

int main(void)
{
	static const struct sync_pulse_clock own_clock = {
		.to_node = same_clock,
		.to_leader = same_clock,
	};
	static const struct link_callbacks link = {
		.connected = on_connected,
		.disconnected = sync_ppi_connection_end,
		.ready = peer_greet,
		.message = on_message,
	};
	static const struct node_config config = {
		.on_capture = sync_task_own_capture,
		.clock = &own_clock,
		.on_batch = on_batch,
		.link = &link,
		.fill_link_stats = follower_stream_stats,
		.every_second = every_second,
	};

	node_run(&config);
}
