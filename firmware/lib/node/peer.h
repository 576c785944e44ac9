/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Do both nodes speak the same protocol table?
 *
 * Each greets the other with HELLO when the link opens. Flashing only one of two boards is an
 * everyday mistake; it must be said, not guessed from odd numbers.
 */
#ifndef BV_PEER_H_
#define BV_PEER_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A new connection: nothing is held against this peer yet. */
void peer_begin(void);

/** Send HELLO to the peer. */
void peer_greet(void);

/**
 * Take the peer's HELLO. A table other than ours is reported as a FAULT.
 *
 * @return false when it is malformed.
 */
bool peer_take_hello(const uint8_t *payload, size_t len);

/** False once the peer has said that its table is another one: refuse what it sends. */
bool peer_compatible(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_PEER_H_ */
