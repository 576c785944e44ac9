/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Scheduled pulses: both nodes raise a pin at the same instants of the leader's clock.
 *
 * TIMER COMPARE sets the pin through PPI and a second COMPARE clears it, so the edge is as good
 * as the clock model and something outside the firmware can measure the truth. Where the other
 * node's pulse is wired to pulse-in-gpios its rising edge is captured in hardware too, which
 * makes a bench without an analyser possible.
 *
 * Pulse n is due at n * CONFIG_BV_PULSE_PERIOD_US of the leader's clock.
 */
#ifndef BV_SYNC_PULSE_H_
#define BV_SYNC_PULSE_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** One pulse, reported after it has passed. Clocks as in the wire table's PULSE message. */
struct sync_pulse_report {
	uint32_t index;
	uint64_t scheduled_ticks_leader;
	uint64_t compare_ticks_node;
	/** 0 when no edge was seen. */
	uint64_t captured_ticks_node;
	/** Could not be armed in time; no edge was made. */
	bool late;
	bool captured;
};

/** What a node knows of the leader's clock. Both are called from the pulse thread. */
struct sync_pulse_clock {
	/** @return false when the leader's clock is not known well enough for a pulse. */
	bool (*to_node)(uint64_t t_ticks_leader, uint64_t *t_ticks_node);
	bool (*to_leader)(uint64_t t_ticks_node, uint64_t *t_ticks_leader);
};

typedef void (*sync_pulse_report_cb)(const struct sync_pulse_report *report);

/**
 * Claim pins, channels and start the pulse thread. sync_timer_init() must have succeeded.
 *
 * @return 0; -ENOMEM when channels have run out; -EIO when a pin is refused.
 */
int sync_pulse_start(const struct sync_pulse_clock *clock, sync_pulse_report_cb on_report);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_PULSE_H_ */
