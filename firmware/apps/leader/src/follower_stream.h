/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The follower's IMU batches as the leader receives them.
 */
#ifndef BV_LEADER_FOLLOWER_STREAM_H_
#define BV_LEADER_FOLLOWER_STREAM_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h"

/**
 * Take a batch, convert its times to the leader's clock and send it on.
 *
 * @return false when it is malformed, not the follower's, or of an impossible time.
 */
bool follower_stream_take(const uint8_t *payload, size_t len);

/** Fill in the counters of received batches. */
void follower_stream_stats(struct wire_link_stats *stats);

#endif /* BV_LEADER_FOLLOWER_STREAM_H_ */
