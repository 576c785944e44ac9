/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What leader and follower have in common: start-up in the right order, the periodic frames and
 * the frames that both send.
 */
#ifndef BV_NODE_H_
#define BV_NODE_H_

#include "imu_source.h"
#include "link.h"
#include "sync_ppi.h"
#include "sync_pulse.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The application's part of the node. All are required. */
struct node_config {
	sync_ppi_capture_cb on_capture;
	const struct sync_pulse_clock *clock;
	imu_source_batch_cb on_batch;
	const struct link_callbacks *link;
	/** Once a second, in the main thread, before LINK stats are sent. */
	void (*fill_link_stats)(struct wire_link_stats *stats);
	/** Once a second, in the main thread. */
	void (*every_second)(void);
};

/**
 * Run the node in the calling thread; never returns.
 *
 * A part that cannot start is reported as a FAULT, again every two seconds, and the others go on.
 */
_Noreturn void node_run(const struct node_config *config);

/** Send one IMU batch on the diagnostic stream. */
void node_send_batch(const struct wire_imu_batch *batch);

/** Send SYNC state on the diagnostic stream. */
void node_send_sync_state(const struct wire_sync_state *state);

/** Send SYNC capture on the diagnostic stream. */
void node_send_sync_capture(const struct wire_sync_capture *capture);

#ifdef __cplusplus
}
#endif

#endif /* BV_NODE_H_ */
