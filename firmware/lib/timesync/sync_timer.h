/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The node's clock: a 16 MHz, 32-bit TIMER that runs from boot, extended to 64 bit.
 *
 * Two TIMER instances start on the same tick and therefore always hold the same count. The first
 * has fixed duties (enum sync_timer_cc); the second lends capture channels to whoever wants an
 * edge on this clock.
 *
 * The crystal oscillator is requested once and never released: without that request TIMER would
 * run from the RC oscillator between radio events and the clock would be worthless.
 */
#ifndef BV_SYNC_TIMER_H_
#define BV_SYNC_TIMER_H_

#include <stdint.h>

#include <hal/nrf_timer.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Instance with fixed duties; it has six capture/compare channels (nRF52840 PS v1.7, 6.30). */
#define SYNC_TIMER     NRF_TIMER3
/** Twin that lends its four channels. */
#define SYNC_TIMER_AUX NRF_TIMER2

#define SYNC_TICKS_PER_US 16U

/** Duties of the channels of SYNC_TIMER. */
enum sync_timer_cc {
	SYNC_CC_RADIO_END = 0,
	SYNC_CC_TX_READY = 1,
	SYNC_CC_RX_READY = 2,
	SYNC_CC_PULSE_SET = 3,
	SYNC_CC_PULSE_CLEAR = 4,
	SYNC_CC_NOW = 5,
};

/**
 * Hold the crystal oscillator, start both timers, check that they agree.
 *
 * @return 0; -EIO when the oscillator does not start; -ENOMEM when no PPI channel is free;
 *         -EFAULT when the twins disagree.
 */
int sync_timer_init(void);

/** Now, in ticks since the timer started. Callable from any context, interrupts included. */
uint64_t sync_timer_now_ticks(void);

/** 64-bit time of a capture taken less than one wrap (268 s) ago. Callable from any context. */
uint64_t sync_timer_extend(uint32_t captured_ticks);

/** Wraps of the 32-bit count since boot. */
uint32_t sync_timer_wraps(void);

/**
 * Claim a channel of the twin for an edge to be captured by PPI.
 *
 * @param[out] channel number for the calls below.
 * @return 0, or -ENOMEM when all four are taken.
 */
int sync_timer_capture_alloc(uint8_t *channel);

/** Task address that a PPI channel triggers to capture into @p channel. */
uint32_t sync_timer_capture_task_address(uint8_t channel);

/** Last captured value of @p channel; extend it with sync_timer_extend(). */
uint32_t sync_timer_capture_ticks(uint8_t channel);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_TIMER_H_ */
