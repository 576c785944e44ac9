/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_ppi.h"

#include <errno.h>

#include <zephyr/devicetree.h>
#include <zephyr/irq.h>
#include <zephyr/kernel.h>

#include <hal/nrf_egu.h>
#include <hal/nrf_radio.h>
#include <nrfx_ppi.h>

#include "sync_ll.h"
#include "sync_pin.h"
#include "sync_timer.h"

/* The link layer's interrupts are at 0 (radio) and 1 and below (the rest). At 0 this one comes
 * right after the radio's own and before the link layer moves its event counter on.
 */
#define EGU_PRIORITY 0
BUILD_ASSERT(EGU_PRIORITY < CONFIG_BT_CTLR_ULL_HIGH_PRIO,
	     "the event counter is read before the link layer's own processing");
#define CAPTURE_EGU  NRF_EGU3
#define CAPTURE_IRQN DT_IRQN(DT_NODELABEL(egu3))

/* Access address of all advertising packets (Bluetooth Core 5.3, Vol 6 Part B, 2.1.2). */
#define ADVERTISING_ACCESS_ADDRESS 0x8E89BED6U

/* The next END is T_IFS plus the shortest packet away, 150 + 44 us on 2M, but the READY that
 * tells its direction comes just before it starts, at T_IFS.
 */
#define TIMELY_TICKS (120U * SYNC_TICKS_PER_US)

#define NO_CONNECTION 0xFFFFU

static sync_ppi_capture_cb capture_cb;
static volatile uint16_t conn_handle = NO_CONNECTION;
static struct sync_event_builder builder;
static struct sync_ppi_stats counters;

static uint32_t access_address(void)
{
	return (nrf_radio_prefix0_get(NRF_RADIO) << 24) | (nrf_radio_base0_get(NRF_RADIO) >> 8);
}

static uint32_t read_cc(enum sync_timer_cc channel)
{
	return nrf_timer_cc_get(SYNC_TIMER, (nrf_timer_cc_channel_t)channel);
}

static void inject_fault(struct sync_capture *capture)
{
	if (CONFIG_BV_FAULT_LATE_CAPTURE_TICKS != 0 && capture->event % 5U == 0U) {
		capture->rx_end_ticks += CONFIG_BV_FAULT_LATE_CAPTURE_TICKS;
	}
}

static void packet_end_isr(const void *unused)
{
	uint32_t end_ticks = read_cc(SYNC_CC_RADIO_END);
	struct sync_packet_end end = {0};
	struct sync_capture capture;
	uint64_t now_ticks;

	ARG_UNUSED(unused);
	nrf_egu_event_clear(CAPTURE_EGU, NRF_EGU_EVENT_TRIGGERED0);
	if (access_address() == ADVERTISING_ACCESS_ADDRESS) {
		counters.advertising++;
		return;
	}
	if (conn_handle == NO_CONNECTION || !sync_ll_event_counter(conn_handle, &end.event)) {
		return;
	}
	now_ticks = sync_timer_now_ticks();
	end.end_ticks = sync_tick_extend_past(now_ticks, end_ticks);
	end.timely = now_ticks - end.end_ticks < TIMELY_TICKS;
	end.tx = sync_end_was_tx(end_ticks, read_cc(SYNC_CC_TX_READY), read_cc(SYNC_CC_RX_READY));
	end.crc_ok = end.tx || nrf_radio_crc_status_check(NRF_RADIO);
	counters.crc_errors += end.crc_ok ? 0U : 1U;
	counters.untimely += end.timely ? 0U : 1U;
	if (sync_event_add(&builder, &end, &capture)) {
		inject_fault(&capture);
		capture_cb(&capture);
	}
}

static uint32_t capture_task(enum sync_timer_cc channel)
{
	return nrf_timer_task_address_get(SYNC_TIMER, nrf_timer_capture_task_get((uint8_t)channel));
}

/* One radio event into one task, and into a second one when @p fork is not 0. */
static int wire_radio_event(nrf_radio_event_t event, uint32_t task, uint32_t fork)
{
	nrf_ppi_channel_t channel;

	if (nrfx_ppi_channel_alloc(&channel) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	(void)nrfx_ppi_channel_assign(channel, nrf_radio_event_address_get(NRF_RADIO, event), task);
	if (fork != 0U) {
		(void)nrfx_ppi_channel_fork_assign(channel, fork);
	}
	(void)nrfx_ppi_channel_enable(channel);
	return 0;
}

int sync_ppi_init(sync_ppi_capture_cb on_capture)
{
	uint32_t toggle_task;
	int err = sync_pin_output(SYNC_PIN(radio_end_gpios), &toggle_task, NULL, NULL);

	if (err) {
		return err;
	}
	capture_cb = on_capture;
	err = wire_radio_event(NRF_RADIO_EVENT_END, capture_task(SYNC_CC_RADIO_END),
			       nrf_egu_task_address_get(CAPTURE_EGU, NRF_EGU_TASK_TRIGGER0));
	if (!err) {
		err = wire_radio_event(NRF_RADIO_EVENT_END, toggle_task, 0U);
	}
	if (!err) {
		err = wire_radio_event(NRF_RADIO_EVENT_TXREADY, capture_task(SYNC_CC_TX_READY), 0U);
	}
	if (!err) {
		err = wire_radio_event(NRF_RADIO_EVENT_RXREADY, capture_task(SYNC_CC_RX_READY), 0U);
	}
	if (err) {
		return err;
	}
	IRQ_CONNECT(CAPTURE_IRQN, EGU_PRIORITY, packet_end_isr, NULL, 0);
	nrf_egu_event_clear(CAPTURE_EGU, NRF_EGU_EVENT_TRIGGERED0);
	nrf_egu_int_enable(CAPTURE_EGU, NRF_EGU_INT_TRIGGERED0);
	irq_enable(CAPTURE_IRQN);
	return 0;
}

void sync_ppi_connection_begin(uint16_t handle, bool central)
{
	unsigned int key = irq_lock();

	sync_event_reset(&builder, central);
	conn_handle = handle;
	irq_unlock(key);
}

void sync_ppi_connection_end(void)
{
	conn_handle = NO_CONNECTION;
}

void sync_ppi_stats_get(struct sync_ppi_stats *stats)
{
	unsigned int key = irq_lock();

	*stats = counters;
	stats->events = builder.events;
	stats->given_up = builder.given_up;
	irq_unlock(key);
}
