/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Radio packet ends captured in hardware.
 *
 * RADIO END, TXREADY and RXREADY go through PPI into captures of the sync timer; END also
 * toggles a pin, so that an analyser sees what was captured, and raises an interrupt above the
 * link layer that reads the captures before the next packet overwrites them.
 */
#ifndef BV_SYNC_PPI_H_
#define BV_SYNC_PPI_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_event.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Counters since boot. */
struct sync_ppi_stats {
	/** Connection events of which at least one packet end was seen. */
	uint32_t events;
	/** Events without a usable first exchange. */
	uint32_t given_up;
	/** Packets of the connection received with a wrong CRC. */
	uint32_t crc_errors;
	/** Packet ends on the advertising channels. */
	uint32_t advertising;
	/** Interrupts that came too late to trust the captures. */
	uint32_t untimely;
};

/** Called in the interrupt, above the link layer: queue the capture and return. */
typedef void (*sync_ppi_capture_cb)(const struct sync_capture *capture);

/**
 * Claim the hardware and start capturing. sync_timer_init() must have succeeded.
 *
 * @return 0; -ENOMEM when PPI or GPIOTE channels have run out; -EIO when a pin is refused.
 */
int sync_ppi_init(sync_ppi_capture_cb on_capture);

/**
 * Attribute packet ends to this connection from now on.
 *
 * @param handle HCI handle.
 * @param central this node's role: it decides which direction an event starts with.
 */
void sync_ppi_connection_begin(uint16_t handle, bool central);

/** Stop attributing packet ends. */
void sync_ppi_connection_end(void);

void sync_ppi_stats_get(struct sync_ppi_stats *stats);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_PPI_H_ */
