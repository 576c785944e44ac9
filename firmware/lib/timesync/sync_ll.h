/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The only place that touches private functions of Zephyr's link layer (ll_sw, Zephyr 4.1).
 *
 * No public interface says to which connection event a packet belongs, and pairing two nodes'
 * captures needs exactly that.
 */
#ifndef BV_SYNC_LL_H_
#define BV_SYNC_LL_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Counter of the connection event that is on the air.
 *
 * Valid only between the event's first RADIO END and the link layer's own processing of the
 * event, hence only in an interrupt above CONFIG_BT_CTLR_ULL_HIGH_PRIO.
 *
 * @param handle HCI connection handle.
 * @param[out] event 16-bit event counter (Bluetooth Core 5.3, Vol 6 Part B, 4.5.1).
 * @return false when there is no such connection.
 */
bool sync_ll_event_counter(uint16_t handle, uint16_t *event);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_LL_H_ */
