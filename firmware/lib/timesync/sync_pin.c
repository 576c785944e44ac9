/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_pin.h"

#include <errno.h>
#include <stddef.h>

#include <nrfx_gpiote.h>

/* One instance on both targets; the GPIO driver of Zephyr has initialised it. */
static const nrfx_gpiote_t gpiote = NRFX_GPIOTE_INSTANCE(0);

int sync_pin_output(uint32_t pin, uint32_t *toggle_task, uint32_t *set_task, uint32_t *clear_task)
{
	static const nrfx_gpiote_output_config_t output = {
		.drive = NRF_GPIO_PIN_S0S1,
		.input_connect = NRF_GPIO_PIN_INPUT_DISCONNECT,
		.pull = NRF_GPIO_PIN_NOPULL,
	};
	nrfx_gpiote_task_config_t task = {
		.polarity = NRF_GPIOTE_POLARITY_TOGGLE,
		.init_val = NRF_GPIOTE_INITIAL_VALUE_LOW,
	};

	if (nrfx_gpiote_channel_alloc(&gpiote, &task.task_ch) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	if (nrfx_gpiote_output_configure(&gpiote, pin, &output, &task) != NRFX_SUCCESS) {
		return -EIO;
	}
	nrfx_gpiote_out_task_enable(&gpiote, pin);
	if (toggle_task != NULL) {
		*toggle_task = nrfx_gpiote_out_task_address_get(&gpiote, pin);
	}
	if (set_task != NULL) {
		*set_task = nrfx_gpiote_set_task_address_get(&gpiote, pin);
	}
	if (clear_task != NULL) {
		*clear_task = nrfx_gpiote_clr_task_address_get(&gpiote, pin);
	}
	return 0;
}

int sync_pin_input(uint32_t pin, uint32_t *event)
{
	static const nrf_gpio_pin_pull_t pull = NRF_GPIO_PIN_PULLDOWN;
	uint8_t channel;
	const nrfx_gpiote_trigger_config_t trigger = {
		.trigger = NRFX_GPIOTE_TRIGGER_LOTOHI,
		.p_in_channel = &channel,
	};
	const nrfx_gpiote_input_pin_config_t input = {
		.p_pull_config = &pull,
		.p_trigger_config = &trigger,
	};

	if (nrfx_gpiote_channel_alloc(&gpiote, &channel) != NRFX_SUCCESS) {
		return -ENOMEM;
	}
	if (nrfx_gpiote_input_configure(&gpiote, pin, &input) != NRFX_SUCCESS) {
		return -EIO;
	}
	nrfx_gpiote_trigger_enable(&gpiote, pin, false);
	*event = nrfx_gpiote_in_event_address_get(&gpiote, pin);
	return 0;
}
