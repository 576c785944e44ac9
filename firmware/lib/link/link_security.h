/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The one peer: whoever proves the same 128-bit key.
 *
 * LE legacy pairing out of band, anew on every connection and without bonding: the key is the
 * temporary key, which both nodes got over their serial lines. It never goes over the air, and has
 * too many values to be tried. Nothing is heard from a peer, and nothing said to it, before the
 * link is encrypted by what came of it. See docs/security.md.
 */
#ifndef BV_LINK_SECURITY_H_
#define BV_LINK_SECURITY_H_

#include <stdbool.h>
#include <stdint.h>

#include <zephyr/bluetooth/conn.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

#define LINK_KEY_SIZE WIRE_LINK_KEY_KEY_COUNT

/** Read the stored key. After calib_store_open(), before link_start(). @return as bt_... */
int link_security_init(void);

/** Bluetooth is up. @return 0 or a negative errno of the Bluetooth stack. */
int link_security_enable(void);

/**
 * Store @p key, all zero: forget it; for connections to come.
 *
 * @return 0; -EAGAIN before link_security_init(); or a negative errno of the flash.
 */
int link_security_take_key(const struct wire_link_key *key);

/** Wait until the peer has proved the key. In the link thread. @return 0 or a negative errno. */
int link_security_wait(struct bt_conn *conn);

/** Whether it has, on the connection there is. */
bool link_security_is_proved(void);

/** Send LINK security on the diagnostic stream, and a FAULT when strangers came. */
void link_security_report(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_LINK_SECURITY_H_ */
