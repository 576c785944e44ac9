/* SPDX-License-Identifier: Apache-2.0 */
/* The two nodes' message handling, as the target drives it. */
#ifndef NODE_PARTS_H_
#define NODE_PARTS_H_

#include "sync_event.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Both as after boot. */
void leader_reset(void);
void follower_reset(void);

void leader_connect(void);
void follower_connect(void);

/* One value from the peer. */
bool leader_receive(uint8_t type, const uint8_t *payload, size_t len);
bool follower_receive(uint8_t type, const uint8_t *payload, size_t len);

/* What the leader's own radio, sensor and threads do meanwhile. */
void leader_capture(const struct sync_capture *capture);
void leader_batch(const struct wire_imu_batch *batch);
void leader_threads(void);

/* What the follower's pulse thread asks. */
void follower_convert(uint64_t t_ticks);

void estimator_reset(void);
void estimator_take(const struct wire_imu_batch *batch);

#ifdef __cplusplus
}
#endif

#endif
