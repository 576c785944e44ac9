/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_wire.h"

_Static_assert((int)SYNC_STATE_UNSYNCED == (int)WIRE_SYNC_STATE_UNSYNCED &&
		       (int)SYNC_STATE_CONVERGING == (int)WIRE_SYNC_STATE_CONVERGING &&
		       (int)SYNC_STATE_LOCKED == (int)WIRE_SYNC_STATE_LOCKED &&
		       (int)SYNC_STATE_HOLDOVER == (int)WIRE_SYNC_STATE_HOLDOVER,
	       "the states travel as they are");

void sync_wire_from_capture(const struct sync_capture *capture, uint8_t generation,
			    struct wire_sync_capture *message)
{
	message->event = capture->event;
	message->generation = generation;
	message->tx_end_ticks_node = capture->tx_end_ticks;
	message->rx_end_ticks_node = capture->rx_end_ticks;
}

void sync_wire_to_capture(const struct wire_sync_capture *message, struct sync_capture *capture)
{
	capture->event = message->event;
	capture->tx_end_ticks = message->tx_end_ticks_node;
	capture->rx_end_ticks = message->rx_end_ticks_node;
}

void sync_wire_from_pair(const struct sync_pair *pair, uint32_t event, uint8_t generation,
			 bool used, struct wire_sync_pair *message)
{
	message->event = event;
	message->generation = generation;
	message->flags = used ? 1U : 0U;
	message->tx_end_ticks_leader = pair->tx_end_ticks_leader;
	message->rx_end_ticks_leader = pair->rx_end_ticks_leader;
	message->tx_end_ticks_follower = pair->tx_end_ticks_follower;
	message->rx_end_ticks_follower = pair->rx_end_ticks_follower;
}

void sync_wire_from_estimate(const struct sync_estimate *estimate, uint8_t generation,
			     struct wire_sync_state *message)
{
	message->t_ref_ticks_leader = estimate->model.t_ref_ticks_leader;
	message->offset_ticks = estimate->model.offset_subticks;
	message->skew = estimate->model.skew_ppt;
	message->residual_rms_ticks = estimate->residual_rms_subticks;
	message->offset_sigma_ticks = estimate->offset_sigma_subticks;
	message->window_us = estimate->window_us;
	message->pairs_used = estimate->pairs_used;
	message->pairs_dropped = estimate->pairs_dropped;
	message->state = (uint8_t)estimate->state;
	message->generation = generation;
}

bool sync_wire_to_model(const struct wire_sync_state *message, struct sync_model *model)
{
	if (message->state > WIRE_SYNC_STATE_HOLDOVER || message->skew > SYNC_WIRE_SKEW_MAX_PPT ||
	    message->skew < -SYNC_WIRE_SKEW_MAX_PPT ||
	    message->offset_ticks > SYNC_WIRE_OFFSET_MAX_SUBTICKS ||
	    message->offset_ticks < -SYNC_WIRE_OFFSET_MAX_SUBTICKS) {
		return false;
	}
	model->t_ref_ticks_leader = message->t_ref_ticks_leader;
	model->offset_subticks = message->offset_ticks;
	model->skew_ppt = message->skew;
	return true;
}
