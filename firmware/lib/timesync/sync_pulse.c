/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_pulse.h"

#include <errno.h>

#include <zephyr/kernel.h>

#include <nrfx_ppi.h>

#include "sync_pin.h"
#include "sync_timer.h"

#define PERIOD_TICKS ((uint64_t)CONFIG_BV_PULSE_PERIOD_US * SYNC_TICKS_PER_US)
#define WIDTH_TICKS  ((uint32_t)CONFIG_BV_PULSE_WIDTH_US * SYNC_TICKS_PER_US)

/* The COMPARE is programmed this long before it is due, from the newest clock model. */
#define LEAD_TICKS (10000U * SYNC_TICKS_PER_US)
/* Closer than this the COMPARE could pass while it is being programmed. */
#define MARGIN_TICKS (200U * SYNC_TICKS_PER_US)
/* How much later than ours the other node's pulse is still waited for. */
#define LISTEN_TICKS (1000U * SYNC_TICKS_PER_US)

#define CLOCK_POLL K_MSEC(50)

BUILD_ASSERT(CONFIG_BV_PULSE_PERIOD_US >= 2 * CONFIG_BV_PULSE_WIDTH_US + 20000,
	     "the pulse period leaves no time to arm the next pulse");

static struct sync_pulse_clock node_clock;
static sync_pulse_report_cb report_cb;
static nrf_ppi_channel_t set_channel;
static nrf_ppi_channel_t clear_channel;
static uint8_t capture_channel;
static uint32_t last_capture;

static K_SEM_DEFINE(started, 0, 1);

static int wire(nrf_ppi_channel_t *channel, uint32_t event, uint32_t task)
{
	if (nrfx_ppi_channel_alloc(channel) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	(void)nrfx_ppi_channel_assign(*channel, event, task);
	return 0;
}

static uint32_t compare_event(enum sync_timer_cc channel)
{
	return nrf_timer_event_address_get(SYNC_TIMER, nrf_timer_compare_event_get((uint8_t)channel));
}

static int wire_output(void)
{
	uint32_t set_task;
	uint32_t clear_task;
	int err = sync_pin_output(SYNC_PIN(pulse_gpios), NULL, &set_task, &clear_task);

	if (!err) {
		err = wire(&set_channel, compare_event(SYNC_CC_PULSE_SET), set_task);
	}
	if (!err) {
		err = wire(&clear_channel, compare_event(SYNC_CC_PULSE_CLEAR), clear_task);
	}
	return err;
}

static int wire_input(void)
{
	nrf_ppi_channel_t channel;
	uint32_t edge_event;
	int err = sync_pin_input(SYNC_PIN(pulse_in_gpios), &edge_event);

	if (!err) {
		err = sync_timer_capture_alloc(&capture_channel);
	}
	if (!err) {
		err = wire(&channel, edge_event, sync_timer_capture_task_address(capture_channel));
	}
	if (!err) {
		last_capture = sync_timer_capture_ticks(capture_channel);
		(void)nrfx_ppi_channel_enable(channel);
	}
	return err;
}

/* Program both edges. The channels are live only while a pulse is pending: a COMPARE left behind
 * would match again at each wrap of the timer.
 */
static bool arm(uint64_t compare_ticks)
{
	unsigned int key = irq_lock();
	uint64_t now_ticks = sync_timer_now_ticks();
	bool in_time = compare_ticks > now_ticks + MARGIN_TICKS;

	if (in_time) {
		nrf_timer_cc_set(SYNC_TIMER, (nrf_timer_cc_channel_t)SYNC_CC_PULSE_SET,
				 (uint32_t)compare_ticks);
		nrf_timer_cc_set(SYNC_TIMER, (nrf_timer_cc_channel_t)SYNC_CC_PULSE_CLEAR,
				 (uint32_t)compare_ticks + WIDTH_TICKS);
		(void)nrfx_ppi_channel_enable(set_channel);
		(void)nrfx_ppi_channel_enable(clear_channel);
	}
	irq_unlock(key);
	return in_time;
}

static void disarm(void)
{
	(void)nrfx_ppi_channel_disable(set_channel);
	(void)nrfx_ppi_channel_disable(clear_channel);
}

static void sleep_until(uint64_t t_ticks_node)
{
	uint64_t now_ticks = sync_timer_now_ticks();

	if (t_ticks_node > now_ticks) {
		k_sleep(K_USEC((t_ticks_node - now_ticks) / SYNC_TICKS_PER_US));
	}
}

/* A wrong or hostile model may put the next pulse anywhere. Only one that is about due, or just
 * missed, is worth this thread's time; the schedule then goes on with the next model.
 */
static bool is_near(uint64_t t_ticks_node)
{
	uint64_t from_ticks = sync_timer_now_ticks() - PERIOD_TICKS;

	return t_ticks_node - from_ticks < 4U * PERIOD_TICKS;
}

static void collect_capture(struct sync_pulse_report *report)
{
	uint32_t capture = sync_timer_capture_ticks(capture_channel);

	if (capture != last_capture) {
		last_capture = capture;
		report->captured = true;
		report->captured_ticks_node = sync_timer_extend(capture);
	}
}

static bool run_pulse(uint32_t index)
{
	struct sync_pulse_report report = {
		.index = index,
		.scheduled_ticks_leader = index * PERIOD_TICKS,
	};
	uint64_t due_ticks_node;

	if (!node_clock.to_node(report.scheduled_ticks_leader, &due_ticks_node) ||
	    !is_near(due_ticks_node)) {
		return false;
	}
	sleep_until(due_ticks_node - LEAD_TICKS);
	/* The model has moved on while this thread slept. */
	if (!node_clock.to_node(report.scheduled_ticks_leader, &report.compare_ticks_node) ||
	    !is_near(report.compare_ticks_node)) {
		return false;
	}
	report.late = !arm(report.compare_ticks_node);
	sleep_until(report.compare_ticks_node + WIDTH_TICKS + LISTEN_TICKS);
	disarm();
	collect_capture(&report);
	report_cb(&report);
	return true;
}

static void pulse_thread(void *p1, void *p2, void *p3)
{
	uint32_t next_index = 0;

	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	(void)k_sem_take(&started, K_FOREVER);
	for (;;) {
		uint64_t now_ticks_leader;
		uint32_t soonest;

		if (!node_clock.to_leader(sync_timer_now_ticks(), &now_ticks_leader)) {
			k_sleep(CLOCK_POLL);
			continue;
		}
		soonest = (uint32_t)((now_ticks_leader + LEAD_TICKS) / PERIOD_TICKS) + 1U;
		/* The schedule only goes forward: a model that steps back repeats no index. Far
		 * back means that the leader has restarted.
		 */
		if (soonest > next_index || next_index - soonest > 2U) {
			next_index = soonest;
		}
		if (run_pulse(next_index)) {
			next_index++;
		} else {
			k_sleep(CLOCK_POLL);
		}
	}
}

/* Above the application: the lead is 10 ms, and a late COMPARE is a lost pulse. */
K_THREAD_DEFINE(bv_pulse, CONFIG_BV_PULSE_STACK_SIZE, pulse_thread, NULL, NULL, NULL,
		K_PRIO_PREEMPT(2), 0, 0);

int sync_pulse_start(const struct sync_pulse_clock *clock, sync_pulse_report_cb on_report)
{
	int err = wire_output();

	if (!err) {
		err = wire_input();
	}
	if (!err) {
		node_clock = *clock;
		report_cb = on_report;
		k_sem_give(&started);
	}
	return err;
}
