/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What the follower knows of the leader's clock: the last model that the leader sent.
 */
#ifndef BV_FOLLOWER_CLOCK_H_
#define BV_FOLLOWER_CLOCK_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sync_pulse.h"
#include "wire.h"

/** For the pulse schedule. False while the model is absent, unlocked or too old. */
extern const struct sync_pulse_clock clock_of_leader;

/** Take a SYNC state from the leader. @return false when it is malformed or impossible. */
bool clock_update(const uint8_t *payload, size_t len);

/** @return false when no model has come yet; otherwise the last one. */
bool clock_last_state(struct wire_sync_state *state);

#endif /* BV_FOLLOWER_CLOCK_H_ */
