/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Hardware time of the rising edges of INT1: GPIOTE -> PPI -> capture of the sync timer.
 *
 * The interrupt that follows reads the captured value at once, so only a second edge within the
 * interrupt's latency could overwrite it. The chip cannot make one before words have been read.
 */
#ifndef BV_LSM6DSOX_EDGE_H_
#define BV_LSM6DSOX_EDGE_H_

#include <stdbool.h>
#include <stdint.h>

#include <zephyr/drivers/gpio.h>
#include <zephyr/kernel.h>

#ifdef __cplusplus
extern "C" {
#endif

struct lsm6dsox_edge {
	const struct gpio_dt_spec *pin;
	/** Pin number over all ports. */
	uint32_t absolute_pin;
	struct gpio_callback callback;
	/** Given once per edge, up to one. */
	struct k_sem seen;
	uint8_t capture_channel;
	/** Time of the last edge, and whether it is new and usable. */
	uint64_t ticks;
	uint32_t count;
	bool fresh;
	/** Set while words are being read: an edge then cannot be tied to a word. */
	bool masked;
};

/** Claim the channels and watch the pin. @return 0, -ENODEV, -ENOMEM or the GPIO driver's error. */
int lsm6dsox_edge_init(struct lsm6dsox_edge *edge, const struct gpio_dt_spec *pin,
		       uint32_t absolute_pin);

/** Wait for an edge. @return 0, or -EAGAIN when none came in time. */
int lsm6dsox_edge_wait(struct lsm6dsox_edge *edge, k_timeout_t timeout);

/** Wake a thread in lsm6dsox_edge_wait(). */
void lsm6dsox_edge_kick(struct lsm6dsox_edge *edge);

/**
 * The last edge, if there was one since the last call, and if no words were being read then.
 *
 * @return false when there is none to use.
 */
bool lsm6dsox_edge_take(struct lsm6dsox_edge *edge, uint64_t *ticks);

/** Words are about to be read (true), or have been (false). */
void lsm6dsox_edge_mask(struct lsm6dsox_edge *edge, bool masked);

/** Whether the pin is active now. */
bool lsm6dsox_edge_is_active(const struct lsm6dsox_edge *edge);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_EDGE_H_ */
