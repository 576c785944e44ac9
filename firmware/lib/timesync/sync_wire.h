/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Between the sync's own structures and the messages of the wire table. Pure C11.
 */
#ifndef BV_SYNC_WIRE_H_
#define BV_SYNC_WIRE_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_estimator.h"
#include "sync_event.h"
#include "sync_math.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Crystals are within 50 ppm each; a model beyond this is nonsense, not a bad crystal. */
#define SYNC_WIRE_SKEW_MAX_PPT 500000000
/** Keeps every sum in the conversions within 64 bit; 35 years. */
#define SYNC_WIRE_OFFSET_MAX_SUBTICKS (INT64_C(1) << 62)

void sync_wire_from_capture(const struct sync_capture *capture, uint8_t generation,
			    struct wire_sync_capture *message);

void sync_wire_to_capture(const struct wire_sync_capture *message, struct sync_capture *capture);

void sync_wire_from_pair(const struct sync_pair *pair, uint32_t event, uint8_t generation,
			 bool used, struct wire_sync_pair *message);

void sync_wire_from_estimate(const struct sync_estimate *estimate, uint8_t generation,
			     struct wire_sync_state *message);

/** @return false, and @p model untouched, when @p message holds impossible values. */
bool sync_wire_to_model(const struct wire_sync_state *message, struct sync_model *model);

/** True for the states in which a model is good enough to be used. */
static inline bool sync_wire_state_usable(uint8_t state)
{
	return state == WIRE_SYNC_STATE_LOCKED || state == WIRE_SYNC_STATE_HOLDOVER;
}

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_WIRE_H_ */
