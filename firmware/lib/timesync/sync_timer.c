/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_timer.h"

#include <errno.h>

#include <zephyr/drivers/clock_control.h>
#include <zephyr/drivers/clock_control/nrf_clock_control.h>
#include <zephyr/init.h>
#include <zephyr/kernel.h>

#include <hal/nrf_egu.h>
#include <nrfx_ppi.h>

#include "sync_math.h"

/* Both timers are started, and later compared, by one event through one PPI channel and its
 * fork. The EGU instance is borrowed for that from sync_ppi.c, whose turn comes later.
 */
#define START_EGU NRF_EGU3

#define AUX_CHANNELS 4U

/* A crystal starts within a millisecond or so (nRF52840 PS v1.7, 6.4.4.2); a dead one never. */
#define HFXO_START_MS 100

/* Far shorter than the 268 s after which an unnoticed wrap would lose 2^32 ticks. */
#define TOUCH_PERIOD K_SECONDS(60)

static struct onoff_client hfxo_client;
static struct sync_tick_extender extender;
static uint8_t aux_taken;

static void touch(struct k_timer *timer)
{
	ARG_UNUSED(timer);
	(void)sync_timer_now_ticks();
}

static K_TIMER_DEFINE(touch_timer, touch, NULL);

static int hold_hfxo(void)
{
	struct onoff_manager *manager =
		z_nrf_clock_control_get_onoff(CLOCK_CONTROL_NRF_SUBSYS_HF);
	int result = 0;
	int err;

	sys_notify_init_spinwait(&hfxo_client.notify);
	err = onoff_request(manager, &hfxo_client);
	if (err < 0) {
		return -EIO;
	}
	for (int waited_ms = 0; waited_ms < HFXO_START_MS; waited_ms++) {
		if (sys_notify_fetch_result(&hfxo_client.notify, &result) != -EAGAIN) {
			return result < 0 ? -EIO : 0;
		}
		k_sleep(K_MSEC(1));
	}
	return -EIO;
}

static void configure(NRF_TIMER_Type *timer)
{
	nrf_timer_task_trigger(timer, NRF_TIMER_TASK_STOP);
	nrf_timer_task_trigger(timer, NRF_TIMER_TASK_CLEAR);
	nrf_timer_mode_set(timer, NRF_TIMER_MODE_TIMER);
	nrf_timer_bit_width_set(timer, NRF_TIMER_BIT_WIDTH_32);
	nrf_timer_prescaler_set(timer, NRF_TIMER_FREQ_16MHz);
}

/* Run the same task on both timers in the same clock cycle. */
static void trigger_both(nrf_ppi_channel_t channel, nrf_timer_task_t task)
{
	(void)nrfx_ppi_channel_assign(
		channel, nrf_egu_event_address_get(START_EGU, NRF_EGU_EVENT_TRIGGERED0),
		nrf_timer_task_address_get(SYNC_TIMER, task));
	(void)nrfx_ppi_channel_fork_assign(channel,
					   nrf_timer_task_address_get(SYNC_TIMER_AUX, task));
	(void)nrfx_ppi_channel_enable(channel);
	nrf_egu_task_trigger(START_EGU, NRF_EGU_TASK_TRIGGER0);
	k_busy_wait(1);
	(void)nrfx_ppi_channel_disable(channel);
	nrf_egu_event_clear(START_EGU, NRF_EGU_EVENT_TRIGGERED0);
}

int sync_timer_init(void)
{
	nrf_ppi_channel_t channel;
	int err = hold_hfxo();

	if (err) {
		return err;
	}
	if (nrfx_ppi_channel_alloc(&channel) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	configure(SYNC_TIMER);
	configure(SYNC_TIMER_AUX);
	trigger_both(channel, NRF_TIMER_TASK_START);
	trigger_both(channel, NRF_TIMER_TASK_CAPTURE0);
	(void)nrfx_ppi_channel_fork_assign(channel, 0);
	(void)nrfx_ppi_channel_free(channel);
	if (nrf_timer_cc_get(SYNC_TIMER, NRF_TIMER_CC_CHANNEL0) !=
	    nrf_timer_cc_get(SYNC_TIMER_AUX, NRF_TIMER_CC_CHANNEL0)) {
		return -EFAULT;
	}
	k_timer_start(&touch_timer, TOUCH_PERIOD, TOUCH_PERIOD);
	return 0;
}

uint64_t sync_timer_now_ticks(void)
{
	unsigned int key = irq_lock();
	uint32_t low;
	uint64_t now_ticks;

	nrf_timer_task_trigger(SYNC_TIMER, nrf_timer_capture_task_get(SYNC_CC_NOW));
	low = nrf_timer_cc_get(SYNC_TIMER, (nrf_timer_cc_channel_t)SYNC_CC_NOW);
	now_ticks = sync_tick_extend(&extender, low);
	irq_unlock(key);
	return now_ticks;
}

uint64_t sync_timer_extend(uint32_t captured_ticks)
{
	return sync_tick_extend_past(sync_timer_now_ticks(), captured_ticks);
}

uint32_t sync_timer_wraps(void)
{
	return (uint32_t)(sync_timer_now_ticks() >> 32);
}

int sync_timer_capture_alloc(uint8_t *channel)
{
	unsigned int key = irq_lock();
	int err = -ENOMEM;

	if (aux_taken < AUX_CHANNELS) {
		*channel = aux_taken++;
		err = 0;
	}
	irq_unlock(key);
	return err;
}

uint32_t sync_timer_capture_task_address(uint8_t channel)
{
	return nrf_timer_task_address_get(SYNC_TIMER_AUX, nrf_timer_capture_task_get(channel));
}

uint32_t sync_timer_capture_ticks(uint8_t channel)
{
	return nrf_timer_cc_get(SYNC_TIMER_AUX, (nrf_timer_cc_channel_t)channel);
}
