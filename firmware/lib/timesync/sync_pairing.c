/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_pairing.h"

void sync_pairing_reset(struct sync_pairing *pairing)
{
	for (uint32_t i = 0; i < SYNC_PAIRING_DEPTH; i++) {
		pairing->valid[i] = false;
	}
}

void sync_pairing_own(struct sync_pairing *pairing, const struct sync_capture *own)
{
	uint32_t slot = own->event % SYNC_PAIRING_DEPTH;

	pairing->own[slot] = *own;
	pairing->valid[slot] = true;
}

bool sync_pairing_match(struct sync_pairing *pairing, const struct sync_capture *peer,
			struct sync_pair *pair)
{
	uint32_t slot = peer->event % SYNC_PAIRING_DEPTH;
	const struct sync_capture *own = &pairing->own[slot];

	if (!pairing->valid[slot] || own->event != peer->event) {
		pairing->unmatched++;
		return false;
	}
	/* One report per event: a repeated one is not a second measurement. */
	pairing->valid[slot] = false;
	pair->tx_end_ticks_leader = own->tx_end_ticks;
	pair->rx_end_ticks_leader = own->rx_end_ticks;
	pair->tx_end_ticks_follower = peer->tx_end_ticks;
	pair->rx_end_ticks_follower = peer->rx_end_ticks;
	return true;
}
