/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What is programmed into the LSM6DSOX, and the proof that it arrived.
 *
 * Each mode is a list of whole register values, built from ST's register definitions, written in
 * order after a reset and read back. Nothing is read, modified and written: a bit that flips on the
 * bus cannot creep into a register unseen.
 */
#ifndef BV_LSM6DSOX_CONFIG_H_
#define BV_LSM6DSOX_CONFIG_H_

#include <stdbool.h>
#include <stdint.h>

#include "lsm6dsox_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lsm6dsox_settings {
	/** Code of the data rate, 1 (12.5 Hz) to 10 (6667 Hz). */
	uint8_t rate_code;
	uint8_t accel_fs_g;
	uint16_t gyro_fs_dps;
	uint16_t watermark_words;
	/** Threshold of the wake-up detection. */
	uint16_t wake_mg;
};

/** The code whose rate is nearest to @p rate_hz. */
uint8_t lsm6dsox_rate_code(uint32_t rate_hz);

/** Nominal rate of a code, with the chip's own trim INTERNAL_FREQ_FINE in its 0.15 % steps. */
float lsm6dsox_rate_hz(uint8_t rate_code, int8_t freq_fine);

/**
 * Whether the chip answers.
 *
 * @param[out] who_am_i what it says it is; LSM6DSOX_ID when all is well.
 * @return 0; -ENODEV when it says something else; or the error of the bus.
 */
int lsm6dsox_config_identify(struct lsm6dsox_bus *bus, uint8_t *who_am_i);

/** Reset the chip, and wait until it is done. @return 0, -ETIMEDOUT or the error of the bus. */
int lsm6dsox_config_reset(struct lsm6dsox_bus *bus);

/**
 * Program streaming, on a chip that was reset: both sensors into the FIFO, watermark on INT1.
 *
 * @return 0; -EIO when a register does not hold what was written; or the error of the bus.
 */
int lsm6dsox_config_stream(struct lsm6dsox_bus *bus, const struct lsm6dsox_settings *settings);

/** Whether the chip still holds what lsm6dsox_config_stream() wrote. @return as that one. */
int lsm6dsox_config_check_stream(struct lsm6dsox_bus *bus,
				 const struct lsm6dsox_settings *settings);

/** Program low power with wake-up on INT1, on a chip that was reset. @return as above. */
int lsm6dsox_config_wake(struct lsm6dsox_bus *bus, const struct lsm6dsox_settings *settings);

/** Whether motion was detected since lsm6dsox_config_wake(). Releases the interrupt. */
int lsm6dsox_config_has_woken(struct lsm6dsox_bus *bus, bool *woken);

/** Read the rate trim. */
int lsm6dsox_config_freq_fine(struct lsm6dsox_bus *bus, int8_t *freq_fine);

/** Read the die temperature in 0.01 deg C. */
int lsm6dsox_config_temperature(struct lsm6dsox_bus *bus, int16_t *temperature_cdegc);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_CONFIG_H_ */
