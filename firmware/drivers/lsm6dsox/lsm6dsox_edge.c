/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_edge.h"

#include <errno.h>

#include <nrfx_gpiote.h>
#include <nrfx_ppi.h>

#include "sync_timer.h"

/* One instance on both targets; the GPIO driver of Zephyr has initialised it. */
static const nrfx_gpiote_t gpiote = NRFX_GPIOTE_INSTANCE(0);

static void on_edge(const struct device *port, struct gpio_callback *callback, uint32_t pins)
{
	struct lsm6dsox_edge *e = CONTAINER_OF(callback, struct lsm6dsox_edge, callback);

	ARG_UNUSED(port);
	ARG_UNUSED(pins);
	e->ticks = sync_timer_extend(sync_timer_capture_ticks(e->capture_channel));
	e->fresh = !e->masked;
	e->count++;
	k_sem_give(&e->seen);
}

static int capture_by_ppi(struct lsm6dsox_edge *e)
{
	nrf_ppi_channel_t channel;
	int err = sync_timer_capture_alloc(&e->capture_channel);

	if (err) {
		return err;
	}
	if (nrfx_ppi_channel_alloc(&channel) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	(void)nrfx_ppi_channel_assign(channel,
				      nrfx_gpiote_in_event_address_get(&gpiote, e->absolute_pin),
				      sync_timer_capture_task_address(e->capture_channel));
	(void)nrfx_ppi_channel_enable(channel);
	return 0;
}

int lsm6dsox_edge_init(struct lsm6dsox_edge *e, const struct gpio_dt_spec *pin,
		       uint32_t absolute_pin)
{
	int err;

	e->pin = pin;
	e->absolute_pin = absolute_pin;
	k_sem_init(&e->seen, 0, 1);
	if (!gpio_is_ready_dt(pin)) {
		return -ENODEV;
	}
	err = gpio_pin_configure_dt(pin, GPIO_INPUT);
	if (!err) {
		gpio_init_callback(&e->callback, on_edge, BIT(pin->pin));
		err = gpio_add_callback_dt(pin, &e->callback);
	}
	/* For an edge the GPIO driver takes a GPIOTE channel, whose event PPI can follow. */
	if (!err) {
		err = gpio_pin_interrupt_configure_dt(pin, GPIO_INT_EDGE_TO_ACTIVE);
	}
	return err ? err : capture_by_ppi(e);
}

int lsm6dsox_edge_wait(struct lsm6dsox_edge *e, k_timeout_t timeout)
{
	return k_sem_take(&e->seen, timeout);
}

void lsm6dsox_edge_kick(struct lsm6dsox_edge *e)
{
	k_sem_give(&e->seen);
}

bool lsm6dsox_edge_take(struct lsm6dsox_edge *e, uint64_t *ticks)
{
	const unsigned int key = irq_lock();
	const bool fresh = e->fresh;

	*ticks = e->ticks;
	e->fresh = false;
	irq_unlock(key);
	return fresh;
}

void lsm6dsox_edge_mask(struct lsm6dsox_edge *e, bool masked)
{
	e->masked = masked;
}

bool lsm6dsox_edge_is_active(const struct lsm6dsox_edge *e)
{
	return gpio_pin_get_dt(e->pin) == 1;
}
