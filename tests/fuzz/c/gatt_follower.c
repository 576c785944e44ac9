/* SPDX-License-Identifier: Apache-2.0 */
/* The follower's sources, whole, so that their state can be put back to that after boot. */
#include "node_parts.h"

#define CONFIG_BV_SYNC_HOLDOVER_MS 3000
#define main                       follower_main

#include "clock.c"
#define generation follower_generation
#include "main.c"

void follower_reset(void)
{
	k_msgq_purge(&captures);
	memset(&last_state, 0, sizeof(last_state));
	memset(&model, 0, sizeof(model));
	received_ticks = 0;
	received = false;
	atomic_clear(&generation);
}

void follower_connect(void)
{
	on_connected(0, false);
}

bool follower_receive(uint8_t type, const uint8_t *payload, size_t len)
{
	return on_message(type, payload, len);
}

void follower_convert(uint64_t t_ticks)
{
	uint64_t converted;

	if (clock_of_leader.to_node(t_ticks, &converted)) {
		(void)clock_of_leader.to_leader(converted, &converted);
	}
	every_second();
}
