/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Arithmetic of the time sync: wraps, packet direction, two-way offset, clock conversion.
 *
 * Pure C11. Nothing here reads a clock: times are arguments.
 *
 * Clocks: `leader` and `follower` are each node's 16 MHz TIMER extended to 64 bit, in ticks.
 * `subticks` are 1/256 tick.
 */
#ifndef BV_SYNC_MATH_H_
#define BV_SYNC_MATH_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SYNC_TICK_RATE_HZ      16000000U
#define SYNC_SUBTICKS_PER_TICK 256

/* ---- Wraps ------------------------------------------------------------------------------- */

/** Extends a free-running 32-bit count that is read at least once per wrap. Zero to start. */
struct sync_tick_extender {
	uint64_t last_ticks;
};

/** 64-bit value of a count read now; reads must come in order. */
uint64_t sync_tick_extend(struct sync_tick_extender *extender, uint32_t count);

/** 64-bit value of a count captured before @p now_ticks and less than one wrap ago. */
uint64_t sync_tick_extend_past(uint64_t now_ticks, uint32_t captured);

/** Extends the 16-bit connection event counter. Zero at each new connection. */
struct sync_event_extender {
	uint32_t last_event;
};

/** 32-bit value of the counter; successive calls must be less than 32768 events apart. */
uint32_t sync_event_extend(struct sync_event_extender *extender, uint16_t event);

/* ---- Packet direction -------------------------------------------------------------------- */

/**
 * Was the packet that just ended sent or received?
 *
 * The radio was made ready for exactly one direction last; that READY is the nearer of the two.
 *
 * @param end_ticks, tx_ready_ticks, rx_ready_ticks 32-bit captures of END, TXREADY, RXREADY.
 */
bool sync_end_was_tx(uint32_t end_ticks, uint32_t tx_ready_ticks, uint32_t rx_ready_ticks);

/* ---- One pair ---------------------------------------------------------------------------- */

/** Both nodes' captures of one connection event, in ticks of their own clocks. */
struct sync_pair {
	uint64_t tx_end_ticks_leader;
	uint64_t rx_end_ticks_leader;
	uint64_t tx_end_ticks_follower;
	uint64_t rx_end_ticks_follower;
};

/**
 * Two-way offset, follower minus leader, in half ticks.
 *
 * offset = 1/2 [(f_rx - l_tx) + (f_tx - l_rx)]: a delay of the radio chain that is the same in
 * both directions cancels. The sum is returned, that is twice the offset, so that nothing is
 * rounded. It belongs to the instant sync_pair_leader_ticks().
 */
int64_t sync_pair_offset_half_ticks(const struct sync_pair *pair);

/** Instant of the leader's clock, in ticks, that the pair's offset belongs to. */
uint64_t sync_pair_leader_ticks(const struct sync_pair *pair);

/**
 * Round trip minus turnaround, (l_rx - l_tx) - (f_tx - f_rx), in ticks: twice the chain delay of
 * the radios. Captures that belong to different packets miss it by a packet's length at least.
 */
int64_t sync_pair_round_trip_ticks(const struct sync_pair *pair);

/* ---- Clock model ------------------------------------------------------------------------- */

/**
 * follower = leader + offset + skew * (leader - t_ref), as it travels on the wire (SYNC state).
 */
struct sync_model {
	uint64_t t_ref_ticks_leader;
	int64_t offset_subticks;
	/** Rate of the follower's clock over the leader's, minus one, in units of 1e-12. */
	int32_t skew_ppt;
};

/** Follower's time of an instant of the leader's clock; rounded to the nearest tick. */
uint64_t sync_model_to_follower(const struct sync_model *model, uint64_t t_ticks_leader);

/** Leader's time of an instant of the follower's clock; rounded to the nearest tick. */
uint64_t sync_model_to_leader(const struct sync_model *model, uint64_t t_ticks_follower);

/** Follower's duration @p subticks expressed in subticks of the leader's clock. */
uint32_t sync_model_period_to_leader(const struct sync_model *model, uint32_t subticks);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_MATH_H_ */
