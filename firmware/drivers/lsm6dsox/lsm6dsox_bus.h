/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * SPI access to the LSM6DSOX: single transfers, and the context that ST's register driver wants.
 */
#ifndef BV_LSM6DSOX_BUS_H_
#define BV_LSM6DSOX_BUS_H_

#include <stddef.h>
#include <stdint.h>

#include <zephyr/drivers/spi.h>

#include "lsm6dsox_decoder.h"
#include "lsm6dsox_reg.h"

#ifdef __cplusplus
extern "C" {
#endif

/** FIFO words in one transfer: two batches of 16 samples. */
#define LSM6DSOX_BUS_WORDS_MAX 64U
#define LSM6DSOX_BUS_BYTES_MAX (LSM6DSOX_BUS_WORDS_MAX * LSM6DSOX_WORD_SIZE)

struct lsm6dsox_bus {
	const struct spi_dt_spec *spi;
	/** For ST's driver; its functions return the negative errno of the transfer. */
	stmdev_ctx_t registers;
	uint64_t busy_ticks;
	uint32_t errors;
	/** One byte of address, then the data. In RAM and of equal length, so that EasyDMA moves
	 * the whole transfer without the CPU in between.
	 */
	uint8_t tx[1U + LSM6DSOX_BUS_BYTES_MAX];
	uint8_t rx[1U + LSM6DSOX_BUS_BYTES_MAX];
};

void lsm6dsox_bus_init(struct lsm6dsox_bus *bus, const struct spi_dt_spec *spi);

/**
 * Read @p size bytes from @p address on, in one transfer.
 *
 * @param size at most LSM6DSOX_BUS_BYTES_MAX.
 * @param[out] data valid until the next transfer.
 * @return 0, -EMSGSIZE, or the negative errno of the SPI driver, which is counted.
 */
int lsm6dsox_bus_read(struct lsm6dsox_bus *bus, uint8_t address, size_t size,
		      const uint8_t **data);

/** Write @p size bytes to @p address on. @return as lsm6dsox_bus_read(). */
int lsm6dsox_bus_write(struct lsm6dsox_bus *bus, uint8_t address, const uint8_t *data,
		       size_t size);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_BUS_H_ */
