/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Pins driven or watched by GPIOTE through PPI, without the CPU.
 */
#ifndef BV_SYNC_PIN_H_
#define BV_SYNC_PIN_H_

#include <stdint.h>

#include <soc_nrf_common.h>
#include <zephyr/devicetree.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Absolute pin number of a property of the zephyr,user node (boards/pins.dtsi). */
#define SYNC_PIN(property) NRF_DT_GPIOS_TO_PSEL(DT_PATH(zephyr_user), property)

/**
 * Give a pin, initially low, to a GPIOTE task channel.
 *
 * @param pin absolute pin number.
 * @param[out] toggle_task, set_task, clear_task task addresses for PPI; NULL when not wanted.
 * @return 0; -ENOMEM when no GPIOTE channel is free; -EIO when the driver refuses the pin.
 */
int sync_pin_output(uint32_t pin, uint32_t *toggle_task, uint32_t *set_task, uint32_t *clear_task);

/**
 * Watch rising edges of a pulled-down pin with a GPIOTE event channel; no interrupt.
 *
 * @param pin absolute pin number.
 * @param[out] event event address for PPI.
 * @return as sync_pin_output().
 */
int sync_pin_input(uint32_t pin, uint32_t *event);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_PIN_H_ */
