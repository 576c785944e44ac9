/* SPDX-License-Identifier: Apache-2.0 */
#include "sync_event.h"

void sync_event_reset(struct sync_event_builder *builder, bool central)
{
	builder->extender.last_event = 0;
	builder->central = central;
	builder->started = false;
	builder->have_first = false;
	builder->closed = false;
}

static bool give_up(struct sync_event_builder *builder)
{
	builder->closed = true;
	builder->given_up++;
	return false;
}

bool sync_event_add(struct sync_event_builder *builder, const struct sync_packet_end *end,
		    struct sync_capture *capture)
{
	uint32_t before = builder->extender.last_event;
	uint32_t event = sync_event_extend(&builder->extender, end->event);
	bool first_is_tx = builder->central;

	if (!builder->started || event != before) {
		if (builder->started && !builder->closed) {
			builder->given_up++;
		}
		builder->started = true;
		builder->have_first = false;
		builder->closed = false;
		builder->events++;
	}
	if (builder->closed) {
		return false;
	}
	if (!end->crc_ok || !end->timely) {
		return give_up(builder);
	}
	if (!builder->have_first) {
		if (end->tx != first_is_tx) {
			return give_up(builder);
		}
		builder->have_first = true;
		builder->first_ticks = end->end_ticks;
		return false;
	}
	if (end->tx == first_is_tx) {
		return give_up(builder);
	}
	builder->closed = true;
	capture->event = event;
	capture->tx_end_ticks = first_is_tx ? builder->first_ticks : end->end_ticks;
	capture->rx_end_ticks = first_is_tx ? end->end_ticks : builder->first_ticks;
	return true;
}
