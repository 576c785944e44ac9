/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_estimator.h"

#include <math.h>

#define TICKS_PER_S  16000000.0
#define TICKS_PER_US 16U
#define MS           (1000U * TICKS_PER_US)

/* Two crystals of 50 ppm each, with room for a bad one [tick/s]. */
#define SKEW_SIGMA_INITIAL (100e-6 * TICKS_PER_S)
/* The wire's skew and sane crystals both end long before this. */
#define SKEW_MAX_PPT 500e6

/* 16 ms. Keeps the sum of squares of a full window within 64 bit. */
#define RESIDUAL_MAX_TICKS 262144.0

/* Follower and leader booted within 8 years of each other. Keeps subticks within 64 bit. */
#define OFFSET_MAX_HALF_TICKS (INT64_C(1) << 53)

struct sync_estimator_params sync_estimator_params_default(void)
{
	return (struct sync_estimator_params){
		/* Best over simulated wander of 0.2..0.3 ppm within 5..40 s, at 7.5 and 30 ms. */
		.wander_per_sqrt_s = 0.2e-6,
		.window_ticks = 2000U * MS,
		.pair_variance_initial = 16.0 * 16.0,
		/* Four stamps quantised to a tick: 1/2 sqrt(4) / sqrt(12) tick rms. */
		.pair_variance_min = 1.0 / 12.0,
		.gate_sigmas = 5.0,
		.gate_min_ticks = 8.0,
		/* 10 us on 2M to 20 us on 1M, a microsecond of stamp noise each way, and room. */
		.round_trip_min_ticks = 0,
		.round_trip_max_ticks = 40 * (int64_t)TICKS_PER_US,
		.rejects_to_restart = 16U,
		.lock_pairs = 16U,
		.lock_span_ticks = 1000U * MS,
		.lock_sigma_ticks = 8.0,
		.holdover_after_ticks = 250U * MS,
		.holdover_max_ticks = 3000U * MS,
	};
}

static double square(double x)
{
	return x * x;
}

static double seconds(uint64_t from_ticks, uint64_t to_ticks)
{
	return (double)(to_ticks - from_ticks) / TICKS_PER_S;
}

/* ---- Window of residuals ----------------------------------------------------------------- */

static void window_drop_oldest(struct sync_estimator *e)
{
	int64_t oldest = e->window[e->window_first].subticks;

	/* Integer squares: what was added is taken away again exactly. */
	e->window_sum_squares -= oldest * oldest;
	e->window_first = (e->window_first + 1U) % SYNC_ESTIMATOR_DEPTH;
	e->window_count--;
}

static void window_add(struct sync_estimator *e, const struct sync_estimator_params *params,
		       uint64_t t_ticks, double residual_ticks)
{
	double clipped = fmax(-RESIDUAL_MAX_TICKS, fmin(RESIDUAL_MAX_TICKS, residual_ticks));
	int64_t subticks = llrint(clipped * SYNC_SUBTICKS_PER_TICK);
	uint32_t slot;

	while (e->window_count > 0U &&
	       (e->window_count == SYNC_ESTIMATOR_DEPTH ||
		t_ticks - e->window[e->window_first].t_ticks_leader > params->window_ticks)) {
		window_drop_oldest(e);
	}
	slot = (e->window_first + e->window_count) % SYNC_ESTIMATOR_DEPTH;
	e->window[slot].t_ticks_leader = t_ticks;
	e->window[slot].subticks = (int32_t)subticks;
	e->window_sum_squares += subticks * subticks;
	e->window_count++;
}

static double window_mean_square_ticks(const struct sync_estimator *e)
{
	return (double)e->window_sum_squares / (double)e->window_count /
	       square(SYNC_SUBTICKS_PER_TICK);
}

/* ---- Filter ------------------------------------------------------------------------------ */

/* Covariance after dt seconds without a pair. */
static void propagate(const struct sync_estimator *e, const struct sync_estimator_params *params,
		      double dt, double *p00, double *p01, double *p11)
{
	double q2 = square(params->wander_per_sqrt_s * TICKS_PER_S);

	*p00 = e->p00 + dt * (2.0 * e->p01 + dt * e->p11) + q2 * dt * dt * dt / 3.0;
	*p01 = e->p01 + dt * e->p11 + q2 * dt * dt / 2.0;
	*p11 = e->p11 + q2 * dt;
}

/* R, as measured from the window. */
static double pair_variance(const struct sync_estimator *e,
			    const struct sync_estimator_params *params)
{
	if (e->window_count < params->lock_pairs) {
		return params->pair_variance_initial;
	}
	return fmax(window_mean_square_ticks(e), params->pair_variance_min);
}

static void start(struct sync_estimator *e, const struct sync_estimator_params *params,
		  uint64_t t_ticks, int64_t offset_half_ticks)
{
	e->started = true;
	e->t_ticks_leader = t_ticks;
	e->t_start_ticks_leader = t_ticks;
	e->anchor_half_ticks = offset_half_ticks;
	e->x0 = 0.0;
	e->x1 = 0.0;
	e->p00 = params->pair_variance_initial;
	e->p01 = 0.0;
	e->p11 = square(SKEW_SIGMA_INITIAL);
	e->used_since_start = 1U;
	e->rejects_in_row = 0U;
	e->window_first = 0U;
	e->window_count = 0U;
	e->window_sum_squares = 0;
}

static bool reject(struct sync_estimator *e, const struct sync_estimator_params *params)
{
	e->dropped++;
	e->rejects_in_row++;
	if (e->rejects_in_row >= params->rejects_to_restart) {
		e->started = false;
		e->restarts++;
	}
	return false;
}

static bool update(struct sync_estimator *e, const struct sync_estimator_params *params,
		   uint64_t t_ticks, int64_t offset_half_ticks)
{
	double dt = seconds(e->t_ticks_leader, t_ticks);
	double predicted = e->x0 + e->x1 * dt;
	double innovation = (double)(offset_half_ticks - e->anchor_half_ticks) / 2.0 - predicted;
	double r = pair_variance(e, params);
	double p00, p01, p11, s, gate, k0, k1;

	propagate(e, params, dt, &p00, &p01, &p11);
	s = p00 + r;
	gate = params->gate_sigmas * sqrt(s);
	if (fabs(innovation) > fmax(gate, params->gate_min_ticks)) {
		return reject(e, params);
	}
	k0 = p00 / s;
	k1 = p01 / s;
	e->x0 = predicted + k0 * innovation;
	e->x1 += k1 * innovation;
	e->p00 = p00 - k0 * p00;
	e->p01 = p01 - k0 * p01;
	e->p11 = p11 - k1 * p01;
	e->t_ticks_leader = t_ticks;
	e->used_since_start++;
	e->rejects_in_row = 0U;
	/* An innovation has variance s = p00 + r; scaled to r it measures the pairs alone. The
	 * first ones are those of an unknown skew and measure nothing.
	 */
	if (e->used_since_start > params->lock_pairs) {
		window_add(e, params, t_ticks, innovation * sqrt(r / s));
	}
	return true;
}

bool sync_estimator_add(struct sync_estimator *e, const struct sync_estimator_params *params,
			const struct sync_pair *pair)
{
	uint64_t t_ticks = sync_pair_leader_ticks(pair);
	int64_t offset_half_ticks = sync_pair_offset_half_ticks(pair);
	int64_t round_trip_ticks = sync_pair_round_trip_ticks(pair);

	if (round_trip_ticks < params->round_trip_min_ticks ||
	    round_trip_ticks > params->round_trip_max_ticks ||
	    offset_half_ticks > OFFSET_MAX_HALF_TICKS ||
	    offset_half_ticks < -OFFSET_MAX_HALF_TICKS) {
		/* Not two captures of one exchange: it says nothing about the clocks, so it does
		 * not count towards a restart.
		 */
		e->dropped++;
		return false;
	}
	if (!e->started) {
		start(e, params, t_ticks, offset_half_ticks);
		return true;
	}
	if (t_ticks <= e->t_ticks_leader) {
		return reject(e, params);
	}
	return update(e, params, t_ticks, offset_half_ticks);
}

/* ---- Reading ----------------------------------------------------------------------------- */

static enum sync_state state_at(const struct sync_estimator *e,
				const struct sync_estimator_params *params, uint64_t now_ticks,
				double sigma_ticks)
{
	uint64_t silence_ticks = now_ticks - e->t_ticks_leader;

	if (!e->started || silence_ticks > params->holdover_max_ticks) {
		return SYNC_STATE_UNSYNCED;
	}
	if (e->used_since_start < params->lock_pairs ||
	    e->t_ticks_leader - e->t_start_ticks_leader < params->lock_span_ticks ||
	    (silence_ticks <= params->holdover_after_ticks &&
	     sigma_ticks > params->lock_sigma_ticks)) {
		return SYNC_STATE_CONVERGING;
	}
	return silence_ticks > params->holdover_after_ticks ? SYNC_STATE_HOLDOVER
							     : SYNC_STATE_LOCKED;
}

static uint32_t to_subticks(double ticks)
{
	double subticks = ticks * SYNC_SUBTICKS_PER_TICK + 0.5;

	return subticks < (double)UINT32_MAX ? (uint32_t)subticks : UINT32_MAX;
}

static int32_t to_ppt(double ticks_per_s)
{
	double ppt = ticks_per_s / TICKS_PER_S * 1e12;

	return (int32_t)lrint(fmax(-SKEW_MAX_PPT, fmin(SKEW_MAX_PPT, ppt)));
}

void sync_estimator_read(const struct sync_estimator *e,
			 const struct sync_estimator_params *params, uint64_t now_ticks_leader,
			 struct sync_estimate *estimate)
{
	double p00, p01, p11;

	*estimate = (struct sync_estimate){.pairs_dropped = e->dropped};
	if (!e->started) {
		estimate->state = SYNC_STATE_UNSYNCED;
		return;
	}
	propagate(e, params, seconds(e->t_ticks_leader, now_ticks_leader), &p00, &p01, &p11);
	estimate->model.t_ref_ticks_leader = e->t_ticks_leader;
	estimate->model.offset_subticks = e->anchor_half_ticks * (SYNC_SUBTICKS_PER_TICK / 2) +
					  llrint(e->x0 * SYNC_SUBTICKS_PER_TICK);
	estimate->model.skew_ppt = to_ppt(e->x1);
	estimate->offset_sigma_subticks = to_subticks(sqrt(p00));
	if (e->window_count > 0U) {
		uint64_t oldest = e->window[e->window_first].t_ticks_leader;

		estimate->residual_rms_subticks = to_subticks(sqrt(window_mean_square_ticks(e)));
		estimate->window_us = (uint32_t)((e->t_ticks_leader - oldest) / TICKS_PER_US);
	}
	estimate->pairs_used = (uint16_t)e->window_count;
	estimate->state = state_at(e, params, now_ticks_leader, sqrt(p00));
}
