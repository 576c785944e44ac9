/* SPDX-License-Identifier: Apache-2.0 */
#include "peer.h"

#include <zephyr/sys/atomic.h>

#include "diag_report.h"
#include "link.h"
#include "wire.h"

static atomic_t incompatible;

void peer_begin(void)
{
	atomic_clear(&incompatible);
}

void peer_greet(void)
{
	struct wire_hello hello;
	uint8_t payload[WIRE_HELLO_SIZE];

	diag_report_fill_hello(&hello);
	(void)link_send(WIRE_HELLO_ID, payload, wire_hello_put(payload, &hello));
}

bool peer_take_hello(const uint8_t *payload, size_t len)
{
	struct wire_hello hello;

	if (!wire_hello_get(&hello, payload, len)) {
		return false;
	}
	if (hello.protocol_version != WIRE_PROTOCOL_VERSION ||
	    hello.schema_hash != WIRE_SCHEMA_HASH) {
		atomic_set(&incompatible, 1);
		diag_report_fault(WIRE_FAULT_CODE_LINK_BAD_PAYLOAD, (uint32_t)hello.schema_hash,
				  "peer has another schema: flash both nodes");
	}
	return true;
}

bool peer_compatible(void)
{
	return !atomic_get(&incompatible);
}
