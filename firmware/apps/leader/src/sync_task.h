/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The leader's side of the time sync: pairs both nodes' captures, estimates, publishes.
 */
#ifndef BV_LEADER_SYNC_TASK_H_
#define BV_LEADER_SYNC_TASK_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_event.h"
#include "sync_math.h"
#include "wire.h"

/** Takes this node's own capture; callable from the interrupt. */
void sync_task_own_capture(const struct sync_capture *capture);

/** Takes the follower's capture. */
void sync_task_peer_capture(const struct sync_capture *capture);

/** A new connection: event numbers start over. */
void sync_task_connection_begin(void);

/**
 * The clock model in force.
 *
 * @return false while the clocks are not tied, or not yet again since the last connection.
 */
bool sync_task_model(struct sync_model *model);

/** The SYNC state published last. */
void sync_task_last_state(struct wire_sync_state *state);

#endif /* BV_LEADER_SYNC_TASK_H_ */
