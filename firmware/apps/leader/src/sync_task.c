/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_task.h"

#include <zephyr/kernel.h>

#include "diag_uart.h"
#include "link.h"
#include "node.h"
#include "sync_estimator.h"
#include "sync_pairing.h"
#include "sync_timer.h"
#include "sync_wire.h"

#define PUBLISH_PERIOD_TICKS (50000U * SYNC_TICKS_PER_US)
#define TICKS_PER_MS         (1000U * SYNC_TICKS_PER_US)

enum item_kind {
	ITEM_OWN,
	ITEM_PEER,
	ITEM_CONNECTION,
};

struct item {
	enum item_kind kind;
	struct sync_capture capture;
};

/* A quarter of a second of both nodes' captures at 7.5 ms. */
K_MSGQ_DEFINE(items, sizeof(struct item), 64, 8);

static struct sync_estimator_params params;
static struct sync_pairing pairing;
static struct sync_estimator estimator;
static uint8_t generation;
/* A pair of the present connection has been used. Until then the follower may be one that has
 * restarted, and the model one of a clock that is gone.
 */
static bool confirmed;

static struct k_spinlock published_lock;
static struct wire_sync_state published;
static struct sync_model published_model;
static bool published_confirmed;

static void queue(enum item_kind kind, const struct sync_capture *capture)
{
	struct item item = {.kind = kind};

	if (capture != NULL) {
		item.capture = *capture;
	}
	/* When full the item is lost: one pair less, nothing worse. */
	(void)k_msgq_put(&items, &item, K_NO_WAIT);
}

void sync_task_own_capture(const struct sync_capture *capture)
{
	queue(ITEM_OWN, capture);
}

void sync_task_peer_capture(const struct sync_capture *capture)
{
	queue(ITEM_PEER, capture);
}

void sync_task_connection_begin(void)
{
	queue(ITEM_CONNECTION, NULL);
}

bool sync_task_model(struct sync_model *model)
{
	k_spinlock_key_t key = k_spin_lock(&published_lock);
	bool usable = published_confirmed && sync_wire_state_usable(published.state);

	*model = published_model;
	k_spin_unlock(&published_lock, key);
	return usable;
}

void sync_task_last_state(struct wire_sync_state *state)
{
	k_spinlock_key_t key = k_spin_lock(&published_lock);

	*state = published;
	k_spin_unlock(&published_lock, key);
}

static void take_own(const struct sync_capture *capture)
{
	struct wire_sync_capture message;

	sync_pairing_own(&pairing, capture);
	sync_wire_from_capture(capture, generation, &message);
	node_send_sync_capture(&message);
}

static void take_peer(const struct sync_capture *capture)
{
	struct sync_pair pair;
	struct wire_sync_pair message;
	uint8_t payload[WIRE_SYNC_PAIR_SIZE];
	bool used;

	if (!sync_pairing_match(&pairing, capture, &pair)) {
		return;
	}
	used = sync_estimator_add(&estimator, &params, &pair);
	confirmed = confirmed || used;
	sync_wire_from_pair(&pair, capture->event, generation, used, &message);
	diag_uart_frame(WIRE_SYNC_PAIR_ID, payload, wire_sync_pair_put(payload, &message));
}

static void begin_connection(void)
{
	k_spinlock_key_t key = k_spin_lock(&published_lock);

	published_confirmed = false;
	k_spin_unlock(&published_lock, key);
	confirmed = false;
	sync_pairing_reset(&pairing);
	generation++;
}

static void take(const struct item *item)
{
	switch (item->kind) {
	case ITEM_OWN:
		take_own(&item->capture);
		break;
	case ITEM_PEER:
		take_peer(&item->capture);
		break;
	case ITEM_CONNECTION:
		begin_connection();
		break;
	}
}

static void inject_fault(struct sync_estimate *estimate)
{
	if (IS_ENABLED(CONFIG_BV_FAULT_SKEW_SIGN)) {
		estimate->model.skew_ppt = -estimate->model.skew_ppt;
	}
}

static void publish(uint64_t now_ticks)
{
	struct sync_estimate estimate;
	struct wire_sync_state state;
	uint8_t payload[WIRE_SYNC_STATE_SIZE];
	k_spinlock_key_t key;

	sync_estimator_read(&estimator, &params, now_ticks, &estimate);
	inject_fault(&estimate);
	sync_wire_from_estimate(&estimate, generation, &state);
	key = k_spin_lock(&published_lock);
	published = state;
	published_model = estimate.model;
	published_confirmed = confirmed;
	k_spin_unlock(&published_lock, key);
	node_send_sync_state(&state);
	(void)link_send(WIRE_SYNC_STATE_ID, payload, wire_sync_state_put(payload, &state));
}

static void sync_thread(void *p1, void *p2, void *p3)
{
	uint64_t next_publish_ticks = 0;

	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	params = sync_estimator_params_default();
	params.wander_per_sqrt_s = CONFIG_BV_SYNC_WANDER_PPB * 1e-9;
	params.window_ticks = (uint64_t)CONFIG_BV_SYNC_WINDOW_MS * TICKS_PER_MS;
	params.holdover_max_ticks = (uint64_t)CONFIG_BV_SYNC_HOLDOVER_MS * TICKS_PER_MS;
	for (;;) {
		struct item item;
		uint64_t now_ticks;

		if (k_msgq_get(&items, &item, K_MSEC(50)) == 0) {
			take(&item);
		}
		now_ticks = sync_timer_now_ticks();
		if (now_ticks >= next_publish_ticks) {
			next_publish_ticks =
				now_ticks - now_ticks % PUBLISH_PERIOD_TICKS + PUBLISH_PERIOD_TICKS;
			publish(now_ticks);
		}
	}
}

/* Not before the application has started the timer. */
K_THREAD_DEFINE(bv_sync, 2048, sync_thread, NULL, NULL, NULL, K_PRIO_PREEMPT(3), 0, 0);
