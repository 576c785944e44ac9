/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Follower: reports its captures of each connection event and its IMU batches to the leader, and
 * raises pulses at the instants of the leader's schedule.
 */
#include <zephyr/kernel.h>

#include "clock.h"
#include "diag_csv.h"
#include "link.h"
#include "node.h"
#include "peer.h"
#include "shadow_log.h"
#include "sync_wire.h"

/* From the interrupt to the thread below: a quarter of a second at 7.5 ms. */
K_MSGQ_DEFINE(captures, sizeof(struct sync_capture), 32, 8);

static atomic_t generation;

static void on_capture(const struct sync_capture *capture)
{
	/* When full the capture is lost: one pair less, nothing worse. */
	(void)k_msgq_put(&captures, capture, K_NO_WAIT);
}

static void report_captures(void *p1, void *p2, void *p3)
{
	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	for (;;) {
		struct sync_capture capture;
		struct wire_sync_capture message;
		uint8_t payload[WIRE_SYNC_CAPTURE_SIZE];

		/* A purge at reconnection wakes the waiter with nothing in its hands. */
		if (k_msgq_get(&captures, &capture, K_FOREVER) != 0) {
			continue;
		}
		sync_wire_from_capture(&capture, (uint8_t)atomic_get(&generation), &message);
		node_send_sync_capture(&message);
		(void)link_send(WIRE_SYNC_CAPTURE_ID, payload,
				wire_sync_capture_put(payload, &message));
	}
}

K_THREAD_DEFINE(bv_captures, 1536, report_captures, NULL, NULL, NULL, K_PRIO_PREEMPT(3), 0, 0);

static void on_batch(const struct wire_imu_batch *batch)
{
	struct wire_imu_batch own = *batch;
	uint8_t payload[WIRE_IMU_BATCH_MAX_SIZE];

	own.source = WIRE_ROLE_FOLLOWER;
	node_send_batch(&own);
	diag_csv_imu(&own);
	if (IS_ENABLED(CONFIG_BV_SHADOW_LOG)) {
		shadow_log_batch(&own);
	}
	(void)link_send(WIRE_IMU_BATCH_ID, payload, wire_imu_batch_put(payload, &own));
}

static void on_connected(uint16_t handle, bool central)
{
	peer_begin();
	atomic_inc(&generation);
	k_msgq_purge(&captures);
	sync_ppi_connection_begin(handle, central);
}

static bool on_message(uint8_t type, const uint8_t *payload, size_t len)
{
	if (type == WIRE_HELLO_ID) {
		return peer_take_hello(payload, len);
	}
	return peer_compatible() && type == WIRE_SYNC_STATE_ID && clock_update(payload, len);
}

static void fill_link_stats(struct wire_link_stats *stats)
{
	ARG_UNUSED(stats);
}

static void every_second(void)
{
	struct wire_sync_state state;

	if (clock_last_state(&state)) {
		diag_csv_sync(&state);
	}
}

int main(void)
{
	static const struct link_callbacks link = {
		.connected = on_connected,
		.disconnected = sync_ppi_connection_end,
		.ready = peer_greet,
		.message = on_message,
	};
	static const struct node_config config = {
		.on_capture = on_capture,
		.clock = &clock_of_leader,
		.on_batch = on_batch,
		.link = &link,
		.fill_link_stats = fill_link_stats,
		.every_second = every_second,
	};

	node_run(&config);
}
