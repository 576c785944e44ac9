/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The sensor on the simulated SPI bus: hands bytes to the chip model and spends the bus's time.
 *
 * Emulated transfers take no time by themselves. Each FIFO word's worth of bytes is moved at the
 * moment it starts on the bus, and then the time it takes is waited for, so that samples arrive in
 * the chip's FIFO while a long burst is still under way.
 */
#define DT_DRV_COMPAT st_lsm6dsox

#include <errno.h>

#include <zephyr/device.h>
#include <zephyr/drivers/emul.h>
#include <zephyr/drivers/gpio.h>
#include <zephyr/drivers/spi.h>
#include <zephyr/drivers/spi_emul.h>
#include <zephyr/kernel.h>

#include "lsm6dsox_decoder.h"
#include "model/model.h"

#define BITS_IN_BYTE 8U

struct emul_config {
	uint32_t frequency_hz;
	unsigned int int1_port;
	unsigned int int1_pin;
};

struct emul_data {
	/* Bus time that did not fill a microsecond yet. */
	uint32_t rest_ns;
};

/* Walks through a set of buffers byte by byte. */
struct cursor {
	const struct spi_buf_set *set;
	size_t buffer;
	size_t offset;
};

static uint8_t *next_byte(struct cursor *c, bool *is_in_set)
{
	while (c->set != NULL && c->buffer < c->set->count &&
	       c->offset == c->set->buffers[c->buffer].len) {
		c->buffer++;
		c->offset = 0;
	}
	*is_in_set = c->set != NULL && c->buffer < c->set->count;
	if (!*is_in_set) {
		return NULL;
	}
	c->offset++;
	return c->set->buffers[c->buffer].buf == NULL
		       ? NULL
		       : (uint8_t *)c->set->buffers[c->buffer].buf + c->offset - 1;
}

static size_t size_of(const struct spi_buf_set *set)
{
	size_t size = 0;

	for (size_t i = 0; set != NULL && i < set->count; i++) {
		size += set->buffers[i].len;
	}
	return size;
}

static void spend(const struct emul_config *config, struct emul_data *data, size_t bytes)
{
	const uint32_t ns_per_byte = BITS_IN_BYTE * (NSEC_PER_SEC / config->frequency_hz);
	const uint32_t ns = data->rest_ns + (uint32_t)bytes * ns_per_byte;

	data->rest_ns = ns % NSEC_PER_USEC;
	k_busy_wait(ns / NSEC_PER_USEC);
}

static int io(const struct emul *target, const struct spi_config *config,
	      const struct spi_buf_set *tx_bufs, const struct spi_buf_set *rx_bufs)
{
	struct emul_data *data = target->data;
	struct cursor tx = {.set = tx_bufs};
	struct cursor rx = {.set = rx_bufs};
	const size_t size = MAX(size_of(tx_bufs), size_of(rx_bufs));
	const uint32_t stall_ms = lsm6dsox_model_stall_ms();

	ARG_UNUSED(config);
	if (stall_ms > 0U) {
		/* As if another device held the bus. */
		k_sleep(K_MSEC(stall_ms));
	}
	for (size_t done = 0; done < size;) {
		/* The address by itself, then a FIFO word at a time. */
		const size_t now = done == 0U ? 1U : MIN(size - done, LSM6DSOX_WORD_SIZE);
		uint8_t mosi[LSM6DSOX_WORD_SIZE];
		uint8_t miso[LSM6DSOX_WORD_SIZE];
		bool is_in_set;

		for (size_t i = 0; i < now; i++) {
			const uint8_t *byte = next_byte(&tx, &is_in_set);

			mosi[i] = byte != NULL ? *byte : 0U;
		}
		lsm6dsox_model_transfer(mosi, miso, now, done == 0U, done + now == size);
		for (size_t i = 0; i < now; i++) {
			uint8_t *byte = next_byte(&rx, &is_in_set);

			if (byte != NULL) {
				*byte = miso[i];
			}
		}
		spend(target->cfg, data, now);
		done += now;
	}
	return 0;
}

static int init(const struct emul *target, const struct device *parent)
{
	const struct emul_config *config = target->cfg;

	ARG_UNUSED(parent);
	lsm6dsox_model_attach(config->int1_port, config->int1_pin, config->frequency_hz);
	return 0;
}

static const struct spi_emul_api api = {
	.io = io,
};

#define EMUL_DEFINE(n)                                                                             \
	static struct emul_data emul_data_##n;                                                     \
	static const struct emul_config emul_config_##n = {                                        \
		.frequency_hz = DT_INST_PROP(n, spi_max_frequency),                                \
		.int1_port = DT_PROP(DT_GPIO_CTLR(DT_DRV_INST(n), int1_gpios), port),                     \
		.int1_pin = DT_INST_GPIO_PIN(n, int1_gpios),                                       \
	};                                                                                         \
	EMUL_DT_INST_DEFINE(n, init, &emul_data_##n, &emul_config_##n, &api, NULL)

DT_INST_FOREACH_STATUS_OKAY(EMUL_DEFINE)
