/* SPDX-License-Identifier: Apache-2.0 */
#include "diag_uart.h"

#include <stdbool.h>
#include <string.h>

#include <zephyr/device.h>
#include <zephyr/drivers/uart.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/ring_buffer.h>

#include "framing.h"
#include "wire.h"

/* EasyDMA counts up to 65535 on the nRF52840; short transfers keep the ring draining evenly. */
#define TX_CHUNK 1024U

/* A full ring takes a third of this at 1 Mbaud. */
#define CLOSE_LIMIT_MS 1000U

#define RX_BUFFER_SIZE 64U
#define RX_RING_SIZE   512U
#define RX_IDLE_US     1000

static const struct device *const uart = DEVICE_DT_GET(DT_CHOSEN(bv_diag_uart));

RING_BUF_DECLARE(tx_ring, CONFIG_BV_DIAG_RING_SIZE);
/* One producer at a time, so that sequence numbers enter the ring in order. The interrupt that
 * takes bytes out does not need the lock: a ring has one writer and one reader.
 */
static K_MUTEX_DEFINE(producer_lock);
static uint16_t next_seq;
static atomic_t tx_active;
static atomic_t dropped;

RING_BUF_DECLARE(rx_ring, RX_RING_SIZE);
static uint8_t rx_buffers[2][RX_BUFFER_SIZE];
static uint8_t rx_buffer_next;
static struct wire_rx receiver;
static diag_uart_command_cb command_cb;

static void process_rx(struct k_work *work)
{
	uint8_t bytes[RX_BUFFER_SIZE];
	uint32_t size;

	ARG_UNUSED(work);
	while ((size = ring_buf_get(&rx_ring, bytes, sizeof(bytes))) > 0U) {
		for (size_t at = 0; at < size;) {
			bool good;

			at += wire_rx_take(&receiver, bytes + at, size - at, &good);
			if (good && command_cb != NULL) {
				command_cb(receiver.type, wire_rx_payload(&receiver),
					   receiver.payload_len);
			}
		}
	}
}

static K_WORK_DEFINE(rx_work, process_rx);

/* Hand the next stretch of the ring to the driver. The caller owns tx_active. */
static void send_next(void)
{
	for (;;) {
		uint8_t *bytes;
		uint32_t size = ring_buf_get_claim(&tx_ring, &bytes, TX_CHUNK);

		if (size > 0U) {
			if (uart_tx(uart, bytes, size, SYS_FOREVER_US) == 0) {
				return;
			}
			/* The driver refused: these bytes are lost, the line must go on. */
			(void)ring_buf_get_finish(&tx_ring, size);
			atomic_inc(&dropped);
			continue;
		}
		(void)ring_buf_get_finish(&tx_ring, 0);
		atomic_clear(&tx_active);
		/* Bytes may have come between the claim and the clear. */
		if (ring_buf_is_empty(&tx_ring) || !atomic_cas(&tx_active, 0, 1)) {
			return;
		}
	}
}

static void start_tx(void)
{
	if (atomic_cas(&tx_active, 0, 1)) {
		send_next();
	}
}

static void uart_event(const struct device *dev, struct uart_event *event, void *unused)
{
	ARG_UNUSED(unused);
	switch (event->type) {
	case UART_TX_DONE:
	case UART_TX_ABORTED:
		(void)ring_buf_get_finish(&tx_ring, (uint32_t)event->data.tx.len);
		send_next();
		break;
	case UART_RX_RDY:
		(void)ring_buf_put(&rx_ring, event->data.rx.buf + event->data.rx.offset,
				   (uint32_t)event->data.rx.len);
		(void)k_work_submit(&rx_work);
		break;
	case UART_RX_BUF_REQUEST:
		rx_buffer_next ^= 1U;
		(void)uart_rx_buf_rsp(dev, rx_buffers[rx_buffer_next], RX_BUFFER_SIZE);
		break;
	case UART_RX_DISABLED:
		/* A framing error stops the receiver; commands must work after it. */
		(void)uart_rx_enable(dev, rx_buffers[rx_buffer_next], RX_BUFFER_SIZE, RX_IDLE_US);
		break;
	default:
		break;
	}
}

int diag_uart_init(diag_uart_command_cb on_command)
{
	int err;

	if (!device_is_ready(uart)) {
		return -ENODEV;
	}
	command_cb = on_command;
	err = uart_callback_set(uart, uart_event, NULL);
	if (!err) {
		err = uart_rx_enable(uart, rx_buffers[rx_buffer_next], RX_BUFFER_SIZE, RX_IDLE_US);
	}
	return err;
}

/* All or nothing: half a frame would cost the reader the next one as well. */
static void put(const uint8_t *bytes, size_t size)
{
	if (size == 0U || ring_buf_space_get(&tx_ring) < size) {
		atomic_inc(&dropped);
		return;
	}
	(void)ring_buf_put(&tx_ring, bytes, (uint32_t)size);
}

void diag_uart_frame(uint8_t type, const uint8_t *payload, size_t len)
{
	static uint8_t frame[WIRE_FRAME_MAX(WIRE_MAX_PAYLOAD_SIZE)];

	(void)k_mutex_lock(&producer_lock, K_FOREVER);
	put(frame, wire_frame(frame, sizeof(frame), type, next_seq++, payload, len));
	(void)k_mutex_unlock(&producer_lock);
	start_tx();
}

void diag_uart_line(const char *text)
{
	static uint8_t line[160];
	size_t size = MIN(strlen(text), sizeof(line) - 2U);

	(void)k_mutex_lock(&producer_lock, K_FOREVER);
	memcpy(line, text, size);
	line[size] = '\r';
	line[size + 1U] = '\n';
	put(line, size + 2U);
	(void)k_mutex_unlock(&producer_lock);
	start_tx();
}

void diag_uart_close(void)
{
	(void)k_mutex_lock(&producer_lock, K_FOREVER);
	for (uint32_t i = 0; i < CLOSE_LIMIT_MS && atomic_get(&tx_active); i++) {
		k_sleep(K_MSEC(1));
	}
	/* The transfer ends when its last byte enters the shift register. */
	k_sleep(K_MSEC(1));
}

void diag_uart_count_dropped(void)
{
	atomic_inc(&dropped);
}

uint32_t diag_uart_dropped(void)
{
	return (uint32_t)atomic_get(&dropped);
}
