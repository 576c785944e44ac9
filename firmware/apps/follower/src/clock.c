/* SPDX-License-Identifier: Apache-2.0 */
#include "clock.h"

#include <zephyr/kernel.h>

#include "node.h"
#include "sync_timer.h"
#include "sync_wire.h"

#define HOLDOVER_TICKS ((uint64_t)CONFIG_BV_SYNC_HOLDOVER_MS * 1000U * SYNC_TICKS_PER_US)

static struct k_spinlock lock;
static struct wire_sync_state last_state;
static struct sync_model model;
static uint64_t received_ticks;
static bool received;

bool clock_update(const uint8_t *payload, size_t len)
{
	struct wire_sync_state state;
	struct sync_model fresh;
	k_spinlock_key_t key;

	if (!wire_sync_state_get(&state, payload, len) || !sync_wire_to_model(&state, &fresh)) {
		return false;
	}
	key = k_spin_lock(&lock);
	last_state = state;
	model = fresh;
	received_ticks = sync_timer_now_ticks();
	received = true;
	k_spin_unlock(&lock, key);
	node_send_sync_state(&state);
	return true;
}

bool clock_last_state(struct wire_sync_state *state)
{
	k_spinlock_key_t key = k_spin_lock(&lock);
	bool known = received;

	*state = last_state;
	k_spin_unlock(&lock, key);
	return known;
}

static bool usable_model(struct sync_model *out)
{
	uint64_t now_ticks = sync_timer_now_ticks();
	k_spinlock_key_t key = k_spin_lock(&lock);
	bool usable = received && sync_wire_state_usable(last_state.state) &&
		      now_ticks - received_ticks < HOLDOVER_TICKS;

	*out = model;
	k_spin_unlock(&lock, key);
	return usable;
}

static bool to_node(uint64_t t_ticks_leader, uint64_t *t_ticks_node)
{
	struct sync_model usable;

	if (!usable_model(&usable)) {
		return false;
	}
	*t_ticks_node = sync_model_to_follower(&usable, t_ticks_leader);
	return true;
}

static bool to_leader(uint64_t t_ticks_node, uint64_t *t_ticks_leader)
{
	struct sync_model usable;

	if (!usable_model(&usable)) {
		return false;
	}
	*t_ticks_leader = sync_model_to_leader(&usable, t_ticks_node);
	return true;
}

const struct sync_pulse_clock clock_of_leader = {.to_node = to_node, .to_leader = to_leader};
