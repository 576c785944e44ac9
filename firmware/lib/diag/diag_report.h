/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * What every node says about itself: HELLO, SYSTEM, FAULT.
 */
#ifndef BV_DIAG_REPORT_H_
#define BV_DIAG_REPORT_H_

#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** FICR DEVICEID of this chip. */
uint64_t diag_report_device_id(void);

/** Fill in HELLO. The reset reason is read from hardware and cleared by the first call. */
void diag_report_fill_hello(struct wire_hello *hello);

/** Send HELLO. */
void diag_report_hello(void);

/** Send SYSTEM; the CPU load is that since the last call. Once a second. */
void diag_report_system(void);

/** Send THREAD of the next thread in turn. Once a second. */
void diag_report_thread(void);

/**
 * Send FAULT.
 *
 * @param code WIRE_FAULT_CODE_...
 * @param argument depends on the code.
 * @param detail ASCII; cut at the field's size.
 */
void diag_report_fault(uint16_t code, uint32_t argument, const char *detail);

#ifdef __cplusplus
}
#endif

#endif /* BV_DIAG_REPORT_H_ */
