/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Bytes that outlive a reset, though not the loss of power.
 *
 * On the chip RAM that no start clears; of the simulated board, whose RAM ends with its process, the
 * last page of the flash, which nothing else uses.
 */
#ifndef BV_RETAINED_H_
#define BV_RETAINED_H_

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RETAINED_SIZE 64U

/** Read all. After power-up it is anything: guard it. */
void retained_get(uint8_t bytes[RETAINED_SIZE]);

/** Write all. Takes no lock: from anywhere, interrupts and fatal errors too. */
void retained_put(const uint8_t bytes[RETAINED_SIZE]);

#ifdef __cplusplus
}
#endif

#endif /* BV_RETAINED_H_ */
