/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Hardware times of FIFO slots: from the captured edges of the watermark interrupt to the time of
 * any slot and to the true sample period.
 *
 * Pure C11; time comes in as ticks of the node's clock, captured by hardware.
 *
 * The chip's oscillator is several percent off nominal and drifts with temperature, so the period
 * is estimated along with the time. Two states, time of a slot and period, are tracked by a Kalman
 * filter whose step is the number of slots between two edges:
 *
 *     t(k + m) = t(k) + m p          p(k + m) = p(k) + w,   w a random walk
 *     z        = t(k) + v            v the jitter of the edge
 *
 *     P_tt += 2 m P_tp + m^2 P_pp + q m^3 / 3
 *     P_tp += m P_pp + q m^2 / 2
 *     P_pp += q m
 *     S = P_tt + R,  K = (P_tt, P_tp) / S
 *
 * (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation",
 * section 6.2.3, continuous white noise acceleration.) It starts from the line through the first
 * two edges and is at first the least-squares line through all of them; later the walk limits the
 * memory, so that the estimate follows a chip that warms up.
 *
 * The state is held in fixed point, ticks * 2^16 and ticks per slot * 2^24: single precision
 * cannot hold a 64-bit time, and double is slow without hardware for it.
 */
#ifndef BV_LSM6DSOX_TIMING_H_
#define BV_LSM6DSOX_TIMING_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What the clock and the chip are like; all of it may be changed before init. */
struct lsm6dsox_timing_params {
	/** Ticks of the node's clock in a second. */
	float tick_rate_hz;
	/** Standard deviation of an edge's captured time, in ticks. */
	float edge_sigma_ticks;
	/** Random walk of the chip's rate, relative, per square root of a second. */
	float rate_walk_per_sqrt_s;
	/** How far the true period may be from nominal, relative, standard deviation. */
	float rate_tolerance;
	/** An edge further from its prediction than this many standard deviations is refused. */
	float gate_sigmas;
	/** Edges refused in a row after which the filter starts anew. */
	uint8_t refused_limit;
};

/** What became of an edge. */
enum lsm6dsox_edge_result {
	/** Used. */
	LSM6DSOX_EDGE_USED,
	/** Too far from where the edges before it put it. */
	LSM6DSOX_EDGE_REFUSED,
	/** Refused, and it was one too many: the filter starts anew at this edge. */
	LSM6DSOX_EDGE_RESTARTED,
};

/** State; the members are public so that a test can set and read them. */
struct lsm6dsox_timing {
	struct lsm6dsox_timing_params params;
	/** Period according to the datasheet, ticks per slot. */
	float nominal_period_ticks;
	/** Time of @ref slot, ticks * 2^16. */
	int64_t t_q16;
	/** Ticks per slot * 2^24. */
	int64_t period_q24;
	/** Covariance of (time, period); ticks^2, ticks^2 per slot, ticks^2 per slot^2. */
	float p_tt;
	float p_tp;
	float p_pp;
	/** Slot of the last edge used. */
	uint32_t slot;
	/** Edges used since init or the last restart. */
	uint32_t edges;
	/** Edges refused since init. */
	uint32_t edges_refused;
	/** Edges refused in a row. */
	uint8_t refused_in_row;
	/** Whether @ref t_q16 means anything yet. */
	bool has_phase;
};

/** Values that suit a 16 MHz clock with hardware capture. */
struct lsm6dsox_timing_params lsm6dsox_timing_defaults(void);

void lsm6dsox_timing_init(struct lsm6dsox_timing *timing,
			  const struct lsm6dsox_timing_params *params, float nominal_rate_hz);

/** The chip restarted its sampling: the phase is unknown, the period about what it was. */
void lsm6dsox_timing_lose_phase(struct lsm6dsox_timing *timing);

/** The numbers of all slots went up by @p slots; the times stay. */
void lsm6dsox_timing_renumber(struct lsm6dsox_timing *timing, int32_t slots);

/** The word of @p slot raised the interrupt at @p edge_ticks. */
enum lsm6dsox_edge_result lsm6dsox_timing_edge(struct lsm6dsox_timing *timing, uint32_t slot,
					       uint64_t edge_ticks);

/**
 * No edge was seen, but at @p now_ticks the newest slot in the FIFO was @p slot.
 *
 * It was written at most a period ago; that is all one knows, and it is weighed so.
 */
void lsm6dsox_timing_newest(struct lsm6dsox_timing *timing, uint32_t slot, uint64_t now_ticks);

/** Whether anything can be said about time. */
bool lsm6dsox_timing_has_phase(const struct lsm6dsox_timing *timing);

/** Time of @p slot, rounded to a tick. Only when there is a phase. */
uint64_t lsm6dsox_timing_slot_ticks(const struct lsm6dsox_timing *timing, uint32_t slot);

/** Last slot written at or before @p now_ticks, by the estimate. Only when there is a phase. */
uint32_t lsm6dsox_timing_slot_at(const struct lsm6dsox_timing *timing, uint64_t now_ticks);

/** Standard deviation, in ticks, that the filter believes of the time of @p slot. */
float lsm6dsox_timing_sigma_ticks(const struct lsm6dsox_timing *timing, uint32_t slot);

/** Estimated period in ticks / 256, the unit of the wire's IMU batch. */
uint32_t lsm6dsox_timing_period_q8(const struct lsm6dsox_timing *timing);

/** Estimated period in ticks. */
float lsm6dsox_timing_period_ticks(const struct lsm6dsox_timing *timing);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_TIMING_H_ */
