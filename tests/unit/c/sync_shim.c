// SPDX-License-Identifier: Apache-2.0
/*
 * Flat doors to firmware/lib/timesync for ctypes: only plain numbers and arrays cross, so the
 * tests know nothing of structure layouts.
 */
#include <stdlib.h>
#include <string.h>

#include "sync_estimator.h"
#include "sync_event.h"
#include "sync_math.h"
#include "sync_pairing.h"
#include "sync_wire.h"

/* ---- Wraps and direction ---- */

void shim_extend_sequence(const uint32_t *counts, uint64_t *ticks, size_t n)
{
	struct sync_tick_extender extender = {0};

	for (size_t i = 0; i < n; i++) {
		ticks[i] = sync_tick_extend(&extender, counts[i]);
	}
}

void shim_extend_events(const uint16_t *events, uint32_t *extended, size_t n)
{
	struct sync_event_extender extender = {0};

	for (size_t i = 0; i < n; i++) {
		extended[i] = sync_event_extend(&extender, events[i]);
	}
}

/* ---- Pairs and model ---- */

static struct sync_pair to_pair(const uint64_t *four)
{
	return (struct sync_pair){
		.tx_end_ticks_leader = four[0],
		.rx_end_ticks_leader = four[1],
		.tx_end_ticks_follower = four[2],
		.rx_end_ticks_follower = four[3],
	};
}

int64_t shim_offset_half_ticks(const uint64_t *four)
{
	struct sync_pair pair = to_pair(four);

	return sync_pair_offset_half_ticks(&pair);
}

int64_t shim_round_trip_ticks(const uint64_t *four)
{
	struct sync_pair pair = to_pair(four);

	return sync_pair_round_trip_ticks(&pair);
}

uint64_t shim_pair_leader_ticks(const uint64_t *four)
{
	struct sync_pair pair = to_pair(four);

	return sync_pair_leader_ticks(&pair);
}

static struct sync_model to_model(uint64_t t_ref, int64_t offset_subticks, int32_t skew_ppt)
{
	return (struct sync_model){
		.t_ref_ticks_leader = t_ref,
		.offset_subticks = offset_subticks,
		.skew_ppt = skew_ppt,
	};
}

uint64_t shim_to_follower(uint64_t t_ref, int64_t offset_subticks, int32_t skew_ppt, uint64_t t)
{
	struct sync_model model = to_model(t_ref, offset_subticks, skew_ppt);

	return sync_model_to_follower(&model, t);
}

uint64_t shim_to_leader(uint64_t t_ref, int64_t offset_subticks, int32_t skew_ppt, uint64_t t)
{
	struct sync_model model = to_model(t_ref, offset_subticks, skew_ppt);

	return sync_model_to_leader(&model, t);
}

uint32_t shim_period_to_leader(int32_t skew_ppt, uint32_t subticks)
{
	struct sync_model model = to_model(0, 0, skew_ppt);

	return sync_model_period_to_leader(&model, subticks);
}

/* A SYNC state as a peer may send it. Returns whether it was accepted. */
bool shim_wire_to_model(uint64_t t_ref, int64_t offset_subticks, int32_t skew, uint8_t state)
{
	struct wire_sync_state message = {
		.t_ref_ticks_leader = t_ref,
		.offset_ticks = offset_subticks,
		.skew = skew,
		.state = state,
	};
	struct sync_model model;

	return sync_wire_to_model(&message, &model);
}

/* ---- Estimator ---- */

struct shim {
	struct sync_estimator_params params;
	struct sync_estimator estimator;
};

struct shim *shim_new(void)
{
	struct shim *shim = calloc(1, sizeof(*shim));

	if (shim != NULL) {
		shim->params = sync_estimator_params_default();
	}
	return shim;
}

void shim_free(struct shim *shim)
{
	free(shim);
}

/* Constant R, wander and gate as given: the textbook filter. */
void shim_make_textbook(struct shim *shim, double wander_per_sqrt_s, double pair_variance)
{
	shim->params.wander_per_sqrt_s = wander_per_sqrt_s;
	shim->params.pair_variance_initial = pair_variance;
	shim->params.lock_pairs = UINT32_MAX;
	shim->params.gate_sigmas = 1e9;
}

/* used[i] says whether pair i, four times each, was used. */
void shim_add(struct shim *shim, const uint64_t *fours, uint8_t *used, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		struct sync_pair pair = to_pair(fours + 4 * i);

		used[i] = sync_estimator_add(&shim->estimator, &shim->params, &pair) ? 1U : 0U;
	}
}

void shim_read(const struct shim *shim, uint64_t now, uint64_t *t_ref, int64_t *offset_subticks,
	       int32_t *skew_ppt, uint32_t *rms, uint32_t *sigma, uint32_t *window_us,
	       uint32_t *pairs_used, uint32_t *pairs_dropped, uint32_t *state)
{
	struct sync_estimate estimate;

	sync_estimator_read(&shim->estimator, &shim->params, now, &estimate);
	*t_ref = estimate.model.t_ref_ticks_leader;
	*offset_subticks = estimate.model.offset_subticks;
	*skew_ppt = estimate.model.skew_ppt;
	*rms = estimate.residual_rms_subticks;
	*sigma = estimate.offset_sigma_subticks;
	*window_us = estimate.window_us;
	*pairs_used = estimate.pairs_used;
	*pairs_dropped = estimate.pairs_dropped;
	*state = (uint32_t)estimate.state;
}

/* ---- Events and pairing ---- */

/*
 * Runs packet ends through the event builder. Each row of ends is {event, tx, crc_ok, timely,
 * ticks}; each row of captures becomes {event, tx_end, rx_end}. Returns the number of captures.
 */
size_t shim_build_events(bool central, const uint64_t *ends, size_t n, uint64_t *captures,
			 uint32_t *events, uint32_t *given_up)
{
	struct sync_event_builder builder = {0};
	size_t count = 0;

	sync_event_reset(&builder, central);
	for (size_t i = 0; i < n; i++) {
		const uint64_t *row = ends + 5 * i;
		struct sync_packet_end end = {
			.event = (uint16_t)row[0],
			.tx = row[1] != 0,
			.crc_ok = row[2] != 0,
			.timely = row[3] != 0,
			.end_ticks = row[4],
		};
		struct sync_capture capture;

		if (sync_event_add(&builder, &end, &capture)) {
			captures[3 * count] = capture.event;
			captures[3 * count + 1] = capture.tx_end_ticks;
			captures[3 * count + 2] = capture.rx_end_ticks;
			count++;
		}
	}
	*events = builder.events;
	*given_up = builder.given_up;
	return count;
}

/* Own captures, then reports of the peer; matched[i] tells which reports found their pair. */
uint32_t shim_pair_up(const uint64_t *own, size_t n_own, const uint64_t *peer, size_t n_peer,
		      bool reset_between, uint8_t *matched)
{
	static struct sync_pairing pairing;

	memset(&pairing, 0, sizeof(pairing));
	for (size_t i = 0; i < n_own; i++) {
		struct sync_capture capture = {(uint32_t)own[3 * i], own[3 * i + 1], own[3 * i + 2]};

		sync_pairing_own(&pairing, &capture);
	}
	if (reset_between) {
		sync_pairing_reset(&pairing);
	}
	for (size_t i = 0; i < n_peer; i++) {
		struct sync_capture capture = {(uint32_t)peer[3 * i], peer[3 * i + 1],
					       peer[3 * i + 2]};
		struct sync_pair pair;

		matched[i] = sync_pairing_match(&pairing, &capture, &pair) ? 1U : 0U;
		if (matched[i] && (pair.tx_end_ticks_follower != capture.tx_end_ticks ||
				   pair.rx_end_ticks_follower != capture.rx_end_ticks)) {
			matched[i] = 2U;
		}
	}
	return pairing.unmatched;
}
