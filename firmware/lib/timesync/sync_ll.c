/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_ll.h"

#include <stddef.h>

#include <zephyr/sys/util.h>
#include <zephyr/version.h>

/* The declarations below copy subsys/bluetooth/controller/ll_sw/ull_conn_internal.h, which is not
 * on the include path of applications.
 */
BUILD_ASSERT(KERNEL_VERSION_MAJOR == 4 && KERNEL_VERSION_MINOR == 1,
	     "check ull_conn_internal.h of this Zephyr before using its private functions");

struct ll_conn;
extern struct ll_conn *ll_connected_get(uint16_t handle);
extern uint16_t ull_conn_event_counter(struct ll_conn *conn);

bool sync_ll_event_counter(uint16_t handle, uint16_t *event)
{
	struct ll_conn *conn = ll_connected_get(handle);

	if (conn == NULL) {
		return false;
	}
	*event = ull_conn_event_counter(conn);
	return true;
}
