/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_bus.h"

#include <errno.h>
#include <string.h>

#include "sync_timer.h"

#define READ_FLAG 0x80U

static int transfer(struct lsm6dsox_bus *bus, size_t size)
{
	const struct spi_buf tx = {.buf = bus->tx, .len = 1U + size};
	const struct spi_buf rx = {.buf = bus->rx, .len = 1U + size};
	const struct spi_buf_set tx_set = {.buffers = &tx, .count = 1U};
	const struct spi_buf_set rx_set = {.buffers = &rx, .count = 1U};
	const uint64_t start_ticks = sync_timer_now_ticks();
	const int err = spi_transceive_dt(bus->spi, &tx_set, &rx_set);

	bus->busy_ticks += sync_timer_now_ticks() - start_ticks;
	if (err) {
		bus->errors++;
	}
	return err;
}

int lsm6dsox_bus_read(struct lsm6dsox_bus *bus, uint8_t address, size_t size, const uint8_t **data)
{
	int err;

	if (size > LSM6DSOX_BUS_BYTES_MAX) {
		return -EMSGSIZE;
	}
	bus->tx[0] = address | READ_FLAG;
	memset(&bus->tx[1], 0, size);
	err = transfer(bus, size);
	*data = &bus->rx[1];
	return err;
}

int lsm6dsox_bus_write(struct lsm6dsox_bus *bus, uint8_t address, const uint8_t *data, size_t size)
{
	if (size > LSM6DSOX_BUS_BYTES_MAX) {
		return -EMSGSIZE;
	}
	bus->tx[0] = address;
	memcpy(&bus->tx[1], data, size);
	return transfer(bus, size);
}

static int32_t st_read(void *handle, uint8_t address, uint8_t *data, uint16_t size)
{
	const uint8_t *read;
	const int err = lsm6dsox_bus_read(handle, address, size, &read);

	if (!err) {
		memcpy(data, read, size);
	}
	return err;
}

static int32_t st_write(void *handle, uint8_t address, const uint8_t *data, uint16_t size)
{
	return lsm6dsox_bus_write(handle, address, data, size);
}

void lsm6dsox_bus_init(struct lsm6dsox_bus *bus, const struct spi_dt_spec *spi)
{
	bus->spi = spi;
	bus->busy_ticks = 0;
	bus->errors = 0;
	bus->registers = (stmdev_ctx_t){
		.read_reg = st_read,
		.write_reg = st_write,
		.handle = bus,
	};
}
