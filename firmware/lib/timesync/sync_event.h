/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * From single packet ends to one capture per connection event. Pure C11.
 *
 * An event holds any number of packets. Only its first exchange is the same on both nodes, so
 * only that one is kept, and only when it is whole: central TX then RX, peripheral RX then TX,
 * the received packet intact. If one node saw a broken packet the other may have counted a
 * different one as the first of the event, so such an event is given up, not repaired.
 */
#ifndef BV_SYNC_EVENT_H_
#define BV_SYNC_EVENT_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_math.h"

#ifdef __cplusplus
extern "C" {
#endif

/** One packet end on the air, as the interrupt found it. */
struct sync_packet_end {
	uint16_t event;
	bool tx;
	/** Received intact; true for sent packets. */
	bool crc_ok;
	/** The captures can be trusted (the interrupt came before the next packet). */
	bool timely;
	uint64_t end_ticks;
};

/** First exchange of one event. */
struct sync_capture {
	uint32_t event;
	uint64_t tx_end_ticks;
	uint64_t rx_end_ticks;
};

/** State; reset with sync_event_reset(). */
struct sync_event_builder {
	struct sync_event_extender extender;
	bool central;
	bool started;
	bool have_first;
	/** Nothing more is wanted of the current event: complete or given up. */
	bool closed;
	uint64_t first_ticks;
	/** Events seen, and those that gave no capture. */
	uint32_t events;
	uint32_t given_up;
};

/** Start of a connection. The counters survive. */
void sync_event_reset(struct sync_event_builder *builder, bool central);

/** @return true when @p end completed the event's first exchange; @p capture is then filled. */
bool sync_event_add(struct sync_event_builder *builder, const struct sync_packet_end *end,
		    struct sync_capture *capture);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_EVENT_H_ */
