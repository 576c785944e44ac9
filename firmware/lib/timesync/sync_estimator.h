/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Offset and skew of the follower's clock from a stream of two-way pairs. Pure C11.
 *
 * A Kalman filter with two states:
 *
 *   x0  follower minus leader, minus an integer anchor [tick]
 *   x1  its rate [tick/s of the leader's clock]
 *   F   = [1 dt; 0 1]
 *   Q   = q^2 [dt^3/3 dt^2/2; dt^2/2 dt]     the crystals' rates walk at random, q [tick/s/sqrt(s)]
 *   H   = [1 0]
 *   R   variance of one pair's offset [tick^2], measured from the residuals of the last window
 *
 * It was chosen over a least-squares line through the last two seconds because the same setting
 * serves a pair every 7.5 ms and every 30 ms, because it carries the skew over a lost connection,
 * and because its sigma is honest there.
 *
 * A pair is checked twice: its round trip must be that of two radios, which exposes captures of
 * different packets, and its innovation must lie within the gate. A run of rejected pairs means
 * that the follower's clock has jumped (it has restarted), and the filter starts over.
 */
#ifndef BV_SYNC_ESTIMATOR_H_
#define BV_SYNC_ESTIMATOR_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_math.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Residuals remembered: 2.4 s at 7.5 ms. A longer window at that rate is cut to this. */
#define SYNC_ESTIMATOR_DEPTH 320U

/** Parameters. All times in ticks of the leader's clock. */
struct sync_estimator_params {
	/** q: wander of the clocks' relative rate [1/sqrt(s)]. More follows faster, averages less. */
	double wander_per_sqrt_s;
	/** Residuals older than this do not count in R, residual rms and the number of pairs. */
	uint64_t window_ticks;
	/** R before anything is known, and its lower bound [tick^2]. */
	double pair_variance_initial;
	double pair_variance_min;
	/** Gate [sigma of the innovation], and the least it ever becomes [tick]. */
	double gate_sigmas;
	double gate_min_ticks;
	/** Round trips outside these belong to no pair of radios [tick]. */
	int64_t round_trip_min_ticks;
	int64_t round_trip_max_ticks;
	/** This many rejected in a row start the filter over. */
	uint32_t rejects_to_restart;
	/** To be called locked: pairs, time they span, sigma of the offset [tick]. */
	uint32_t lock_pairs;
	uint64_t lock_span_ticks;
	double lock_sigma_ticks;
	/** Silence that ends the lock, and that ends the holdover after it. */
	uint64_t holdover_after_ticks;
	uint64_t holdover_max_ticks;
};

/** Parameters that suit 5 ms to 100 ms between pairs; see the source for the reasons. */
struct sync_estimator_params sync_estimator_params_default(void);

/** Innovation of one pair, scaled to the variance R of the pair alone. */
struct sync_residual {
	uint64_t t_ticks_leader;
	int32_t subticks;
};

/** State. All zero to start; settable, so that a test can begin anywhere. */
struct sync_estimator {
	bool started;
	/** Instant of the last pair used, and of the first since the start. */
	uint64_t t_ticks_leader;
	uint64_t t_start_ticks_leader;
	int64_t anchor_half_ticks;
	double x0, x1;
	double p00, p01, p11;
	uint32_t used_since_start;
	uint32_t rejects_in_row;

	struct sync_residual window[SYNC_ESTIMATOR_DEPTH];
	uint32_t window_first;
	uint32_t window_count;
	int64_t window_sum_squares;

	/** Counters since boot. */
	uint32_t dropped;
	uint32_t restarts;
};

/** Same values as the wire's SYNC_STATES. */
enum sync_state {
	SYNC_STATE_UNSYNCED = 0,
	SYNC_STATE_CONVERGING = 1,
	SYNC_STATE_LOCKED = 2,
	SYNC_STATE_HOLDOVER = 3,
};

/** What follows from the state at one instant. */
struct sync_estimate {
	struct sync_model model;
	/** RMS of the window's residuals. */
	uint32_t residual_rms_subticks;
	/** Standard error of the offset at the instant asked for. */
	uint32_t offset_sigma_subticks;
	/** Time spanned by the window's pairs, and their number. */
	uint32_t window_us;
	uint16_t pairs_used;
	/** Pairs rejected since boot. */
	uint32_t pairs_dropped;
	enum sync_state state;
};

/** Take one pair. Pairs come in order of time. @return false when it was rejected. */
bool sync_estimator_add(struct sync_estimator *estimator,
			const struct sync_estimator_params *params, const struct sync_pair *pair);

/** What is known at @p now_ticks_leader, not before the last pair. */
void sync_estimator_read(const struct sync_estimator *estimator,
			 const struct sync_estimator_params *params, uint64_t now_ticks_leader,
			 struct sync_estimate *estimate);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_ESTIMATOR_H_ */
