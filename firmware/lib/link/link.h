/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Messages between the nodes over BLE.
 *
 * The follower advertises one GATT service; the leader scans for its UUID, connects, raises MTU,
 * data length and PHY, and subscribes. After a loss both start over by themselves. A message is
 * one ATT value: `type u8, payload` of the wire table. Whatever the peer sends is checked before
 * it is used, and refused messages are counted.
 */
#ifndef BV_LINK_H_
#define BV_LINK_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What the application does with the link. All are required. */
struct link_callbacks {
	/** A connection exists, though nothing can be sent yet. In the Bluetooth RX thread. */
	void (*connected)(uint16_t handle, bool central);
	/** The connection is gone. In a Bluetooth thread. */
	void (*disconnected)(void);
	/** Both ways are open. In the link thread; link_send() works from now on. */
	void (*ready)(void);
	/**
	 * A message came. In the Bluetooth RX thread; copy what is kept.
	 *
	 * @return false to refuse it: unknown type, wrong length, impossible value.
	 */
	bool (*message)(uint8_t type, const uint8_t *payload, size_t len);
};

/**
 * Start Bluetooth and the link thread.
 *
 * @return 0, or the negative errno of the Bluetooth stack.
 */
int link_start(const struct link_callbacks *callbacks);

/**
 * Queue a message. Never waits; from any thread.
 *
 * @return 0; -ENOTCONN while the link is not ready; -ENOSPC when the queue is full (counted);
 *         -EMSGSIZE when @p len exceeds WIRE_MAX_PAYLOAD_SIZE.
 */
int link_send(uint8_t type, const uint8_t *payload, size_t len);

/**
 * End the connection, if there is one; the nodes then connect anew by themselves.
 *
 * @param hold_ms how long this node stays away from the radio first.
 */
void link_drop(uint16_t hold_ms);

/**
 * Fill in what the link knows; the rest of @p stats is left as it is. Asks the controller for
 * the RSSI, so not from a Bluetooth callback.
 */
void link_stats_fill(struct wire_link_stats *stats);

#ifdef __cplusplus
}
#endif

#endif /* BV_LINK_H_ */
