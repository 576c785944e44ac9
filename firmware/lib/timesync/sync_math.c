/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_math.h"

#define PPT 1e-12

uint64_t sync_tick_extend(struct sync_tick_extender *extender, uint32_t count)
{
	extender->last_ticks += (uint32_t)(count - (uint32_t)extender->last_ticks);
	return extender->last_ticks;
}

uint64_t sync_tick_extend_past(uint64_t now_ticks, uint32_t captured)
{
	return now_ticks - (uint32_t)((uint32_t)now_ticks - captured);
}

uint32_t sync_event_extend(struct sync_event_extender *extender, uint16_t event)
{
	/* Signed: a packet of the event before may be reported after one of the next. */
	int32_t step = (int16_t)(uint16_t)(event - (uint16_t)extender->last_event);

	extender->last_event = (uint32_t)((int64_t)extender->last_event + step);
	return extender->last_event;
}

bool sync_end_was_tx(uint32_t end_ticks, uint32_t tx_ready_ticks, uint32_t rx_ready_ticks)
{
	uint32_t since_tx_ready = end_ticks - tx_ready_ticks;
	uint32_t since_rx_ready = end_ticks - rx_ready_ticks;

	return since_tx_ready < since_rx_ready;
}

/* Sums and differences of times are formed unsigned: exact modulo 2^64 and defined for whatever a
 * peer sends. As signed numbers they are right while the clocks are less than 2^62 ticks apart.
 */
static int64_t difference(uint64_t a, uint64_t b)
{
	return (int64_t)(a - b);
}

int64_t sync_pair_offset_half_ticks(const struct sync_pair *pair)
{
	return (int64_t)((pair->rx_end_ticks_follower - pair->tx_end_ticks_leader) +
			 (pair->tx_end_ticks_follower - pair->rx_end_ticks_leader));
}

uint64_t sync_pair_leader_ticks(const struct sync_pair *pair)
{
	return pair->tx_end_ticks_leader +
	       (pair->rx_end_ticks_leader - pair->tx_end_ticks_leader) / 2U;
}

int64_t sync_pair_round_trip_ticks(const struct sync_pair *pair)
{
	return (int64_t)((pair->rx_end_ticks_leader - pair->tx_end_ticks_leader) -
			 (pair->tx_end_ticks_follower - pair->rx_end_ticks_follower));
}

static int64_t round_to_int64(double x)
{
	return (int64_t)(x < 0.0 ? x - 0.5 : x + 0.5);
}

/* offset + skew * dt, in subticks. Only the small term goes through floating point: dt below
 * 2^53 ticks is exact in a double, and skew * dt keeps 1e-16 of itself.
 */
static int64_t offset_subticks_at(const struct sync_model *model, int64_t dt_ticks)
{
	double drift_ticks = (double)dt_ticks * ((double)model->skew_ppt * PPT);

	return model->offset_subticks + round_to_int64(drift_ticks * SYNC_SUBTICKS_PER_TICK);
}

/* Nearest tick, halves up, for negative offsets too. */
static int64_t subticks_to_ticks(int64_t subticks)
{
	int64_t shifted = subticks + SYNC_SUBTICKS_PER_TICK / 2;
	int64_t ticks = shifted / SYNC_SUBTICKS_PER_TICK;

	return shifted < ticks * SYNC_SUBTICKS_PER_TICK ? ticks - 1 : ticks;
}

uint64_t sync_model_to_follower(const struct sync_model *model, uint64_t t_ticks_leader)
{
	int64_t dt_ticks = difference(t_ticks_leader, model->t_ref_ticks_leader);

	return t_ticks_leader + (uint64_t)subticks_to_ticks(offset_subticks_at(model, dt_ticks));
}

uint64_t sync_model_to_leader(const struct sync_model *model, uint64_t t_ticks_follower)
{
	double skew = (double)model->skew_ppt * PPT;
	/* follower - t_ref - offset = (1 + skew) (leader - t_ref), solved for leader. */
	int64_t from_ref_ticks = difference(t_ticks_follower, model->t_ref_ticks_leader);
	double follower_dt_ticks =
		(double)from_ref_ticks - (double)(model->offset_subticks / SYNC_SUBTICKS_PER_TICK) -
		(double)(model->offset_subticks % SYNC_SUBTICKS_PER_TICK) / SYNC_SUBTICKS_PER_TICK;
	double drift_ticks = follower_dt_ticks * (skew / (1.0 + skew));
	int64_t total_subticks =
		model->offset_subticks + round_to_int64(drift_ticks * SYNC_SUBTICKS_PER_TICK);

	/* Subtract, then round: rounding the offset first would turn halves the other way. */
	return t_ticks_follower + (uint64_t)subticks_to_ticks(-total_subticks);
}

uint32_t sync_model_period_to_leader(const struct sync_model *model, uint32_t subticks)
{
	double skew = (double)model->skew_ppt * PPT;

	return (uint32_t)((double)subticks / (1.0 + skew) + 0.5);
}
