/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_timing.h"

#include <math.h>
#include <string.h>

#define T_ONE      65536.0f
#define PERIOD_ONE 16777216.0f
#define Q24_TO_Q16 8

struct lsm6dsox_timing_params lsm6dsox_timing_defaults(void)
{
	return (struct lsm6dsox_timing_params){
		.tick_rate_hz = 16e6f,
		.edge_sigma_ticks = 5.0f,
		.rate_walk_per_sqrt_s = 2e-6f,
		.rate_tolerance = 0.1f,
		.gate_sigmas = 6.0f,
		.refused_limit = 4,
	};
}

static float square(float x)
{
	return x * x;
}

/* Uncertainty of the period when nothing but the datasheet speaks for it. */
static void forget_period(struct lsm6dsox_timing *t)
{
	t->p_tp = 0.0f;
	t->p_pp = square(t->nominal_period_ticks * t->params.rate_tolerance);
}

void lsm6dsox_timing_init(struct lsm6dsox_timing *t, const struct lsm6dsox_timing_params *params,
			  float nominal_rate_hz)
{
	memset(t, 0, sizeof(*t));
	t->params = *params;
	t->nominal_period_ticks = params->tick_rate_hz / nominal_rate_hz;
	t->period_q24 = (int64_t)(t->nominal_period_ticks * PERIOD_ONE);
	forget_period(t);
}

void lsm6dsox_timing_lose_phase(struct lsm6dsox_timing *t)
{
	t->has_phase = false;
	t->edges = 0;
	t->refused_in_row = 0;
	forget_period(t);
}

void lsm6dsox_timing_renumber(struct lsm6dsox_timing *t, int32_t slots)
{
	t->slot += (uint32_t)slots;
}

/* Growth of the period's variance, ticks^2 per slot^2, in one slot. */
static float walk_per_slot(const struct lsm6dsox_timing *t)
{
	const float period_ticks = lsm6dsox_timing_period_ticks(t);
	const float period_s = period_ticks / t->params.tick_rate_hz;

	return square(t->params.rate_walk_per_sqrt_s * period_ticks) * period_s;
}

static int64_t slots_between_q16(const struct lsm6dsox_timing *t, int32_t slots)
{
	/* Rounded, so that stepping there in two goes is the same as in one to half a unit. */
	return (t->period_q24 * slots + (1 << (Q24_TO_Q16 - 1))) >> Q24_TO_Q16;
}

static float variance_after(const struct lsm6dsox_timing *t, float m)
{
	return t->p_tt + 2.0f * m * t->p_tp + m * m * t->p_pp +
	       walk_per_slot(t) * fabsf(m * m * m) / 3.0f;
}

static void advance(struct lsm6dsox_timing *t, uint32_t slot)
{
	const int32_t slots = (int32_t)(slot - t->slot);
	const float m = (float)slots;
	const float q = walk_per_slot(t);

	t->t_q16 += slots_between_q16(t, slots);
	t->p_tt = variance_after(t, m);
	t->p_tp += m * t->p_pp + q * m * fabsf(m) / 2.0f;
	t->p_pp += q * fabsf(m);
	t->slot = slot;
}

static void correct(struct lsm6dsox_timing *t, float innovation, float variance)
{
	const float s = t->p_tt + variance;
	const float k_t = t->p_tt / s;
	const float k_p = t->p_tp / s;

	t->t_q16 += (int64_t)lrintf(k_t * innovation * T_ONE);
	t->period_q24 += (int64_t)(k_p * innovation * PERIOD_ONE);
	t->p_pp -= k_p * t->p_tp;
	t->p_tp -= k_t * t->p_tp;
	t->p_tt -= k_t * t->p_tt;
}

static void set_phase(struct lsm6dsox_timing *t, uint32_t slot, int64_t t_q16, float variance)
{
	t->slot = slot;
	t->t_q16 = t_q16;
	t->p_tt = variance;
	t->p_tp = 0.0f;
	t->has_phase = true;
	t->refused_in_row = 0;
}

static void begin(struct lsm6dsox_timing *t, uint32_t slot, int64_t edge_q16, float variance)
{
	forget_period(t);
	set_phase(t, slot, edge_q16, variance);
	t->edges = 1;
}

/*
 * The line through the first two edges. The general step would get there as well, but as the
 * difference of two numbers 1e10 times the result, which single precision cannot do.
 *
 * False when the two are not a whole number of slots apart at any rate the chip may have.
 */
static bool second_edge(struct lsm6dsox_timing *t, uint32_t slot, int64_t edge_q16, float variance)
{
	const int32_t slots = (int32_t)(slot - t->slot);
	const float m = (float)slots;
	int64_t period_q24;

	if (slots <= 0) {
		return false;
	}
	period_q24 = ((edge_q16 - t->t_q16) << Q24_TO_Q16) / slots;
	if (fabsf((float)period_q24 / PERIOD_ONE - t->nominal_period_ticks) >
	    3.0f * t->params.rate_tolerance * t->nominal_period_ticks) {
		return false;
	}
	t->period_q24 = period_q24;
	t->t_q16 = edge_q16;
	t->slot = slot;
	t->p_tt = variance;
	t->p_tp = variance / m;
	t->p_pp = 2.0f * variance / (m * m);
	t->edges = 2;
	return true;
}

enum lsm6dsox_edge_result lsm6dsox_timing_edge(struct lsm6dsox_timing *t, uint32_t slot,
					       uint64_t edge_ticks)
{
	const float variance = square(t->params.edge_sigma_ticks);
	const int64_t edge_q16 = (int64_t)(edge_ticks << 16);
	struct lsm6dsox_timing ahead;
	float innovation;

	if (t->edges == 0U) {
		/* The first edge beats whatever was guessed without one. */
		begin(t, slot, edge_q16, variance);
		return LSM6DSOX_EDGE_USED;
	}
	if (t->edges == 1U) {
		if (second_edge(t, slot, edge_q16, variance)) {
			return LSM6DSOX_EDGE_USED;
		}
		t->edges_refused++;
		begin(t, slot, edge_q16, variance);
		return LSM6DSOX_EDGE_RESTARTED;
	}
	ahead = *t;
	advance(&ahead, slot);
	innovation = (float)(edge_q16 - ahead.t_q16) / T_ONE;
	if (fabsf(innovation) > t->params.gate_sigmas * sqrtf(ahead.p_tt + variance)) {
		t->edges_refused++;
		t->refused_in_row++;
		if (t->refused_in_row < t->params.refused_limit) {
			return LSM6DSOX_EDGE_REFUSED;
		}
		begin(t, slot, edge_q16, variance);
		return LSM6DSOX_EDGE_RESTARTED;
	}
	*t = ahead;
	correct(t, innovation, variance);
	t->edges++;
	t->refused_in_row = 0;
	return LSM6DSOX_EDGE_USED;
}

void lsm6dsox_timing_newest(struct lsm6dsox_timing *t, uint32_t slot, uint64_t now_ticks)
{
	const float period_ticks = lsm6dsox_timing_period_ticks(t);
	const float variance = square(period_ticks) / 12.0f;
	const int64_t middle_q16 = (int64_t)(now_ticks << 16) - slots_between_q16(t, 1) / 2;

	if (t->edges == 1U) {
		/* A single edge tells no rate, and the next one is overdue. */
		t->edges = 0;
	}
	if (!t->has_phase) {
		set_phase(t, slot, middle_q16, variance);
		return;
	}
	advance(t, slot);
	correct(t, (float)(middle_q16 - t->t_q16) / T_ONE, variance);
}

bool lsm6dsox_timing_has_phase(const struct lsm6dsox_timing *t)
{
	return t->has_phase;
}

uint64_t lsm6dsox_timing_slot_ticks(const struct lsm6dsox_timing *t, uint32_t slot)
{
	const int64_t t_q16 = t->t_q16 + slots_between_q16(t, (int32_t)(slot - t->slot));

	return t_q16 < 0 ? 0U : (uint64_t)((t_q16 + 0x8000) >> 16);
}

uint32_t lsm6dsox_timing_slot_at(const struct lsm6dsox_timing *t, uint64_t now_ticks)
{
	const int64_t since_q24 = ((int64_t)(now_ticks << 16) - t->t_q16) << Q24_TO_Q16;
	int64_t slots = since_q24 / t->period_q24;

	if (since_q24 < 0 && slots * t->period_q24 != since_q24) {
		slots--;
	}
	return t->slot + (uint32_t)(int32_t)slots;
}

float lsm6dsox_timing_sigma_ticks(const struct lsm6dsox_timing *t, uint32_t slot)
{
	return sqrtf(variance_after(t, (float)(int32_t)(slot - t->slot)));
}

uint32_t lsm6dsox_timing_period_q8(const struct lsm6dsox_timing *t)
{
	return (uint32_t)((t->period_q24 + 0x8000) >> 16);
}

float lsm6dsox_timing_period_ticks(const struct lsm6dsox_timing *t)
{
	return (float)t->period_q24 / PERIOD_ONE;
}
