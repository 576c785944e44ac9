/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What the two roles of the link implement, and what they use. Private to lib/link.
 */
#ifndef BV_LINK_ROLE_H_
#define BV_LINK_ROLE_H_

#include <stdbool.h>
#include <stdint.h>

#include <zephyr/bluetooth/conn.h>
#include <zephyr/bluetooth/uuid.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LINK_UUID_SERVICE_VAL                                                                      \
	BT_UUID_128_ENCODE(0x6f1b0001, 0x52d4, 0x4c0e, 0x9a57, 0xb3f24c81d6e5)
#define LINK_UUID_TO_LEADER_VAL                                                                    \
	BT_UUID_128_ENCODE(0x6f1b0002, 0x52d4, 0x4c0e, 0x9a57, 0xb3f24c81d6e5)
#define LINK_UUID_TO_FOLLOWER_VAL                                                                  \
	BT_UUID_128_ENCODE(0x6f1b0003, 0x52d4, 0x4c0e, 0x9a57, 0xb3f24c81d6e5)

/** Largest ATT value the link sends: type and payload. */
#define LINK_VALUE_MAX (1U + WIRE_MAX_PAYLOAD_SIZE)

/**
 * Look for the peer until a connection comes up or may have failed. In the link thread.
 *
 * @return 0 when link_wait_connected() is worth calling, else a negative errno.
 */
int link_role_seek(void);

/** Make both ways usable. In the link thread. @return 0 or a negative errno. */
int link_role_setup(struct bt_conn *conn);

/** Send one value; may wait for buffers. In the link thread. @return 0 or a negative errno. */
int link_role_transmit(struct bt_conn *conn, const uint8_t *value, uint16_t len);

/** Check and deliver a value from the peer. From Bluetooth callbacks. */
void link_receive(const void *value, uint16_t len);

#ifdef __cplusplus
}
#endif

#endif /* BV_LINK_ROLE_H_ */
