/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Feeds standard input to wire_rx_byte() and does with each good frame all that can be done with
 * one, in heap blocks of exactly the right size, so that a sanitizer sees any step outside. Prints
 * the receiver's counters. Exits with 1 when a frame or a payload does not survive its round trip.
 */
#include <stdio.h>
#include <stdlib.h>

#include "framing.h"
#include "messages.h"

static void fail(const char *what)
{
	(void)fprintf(stderr, "%s\n", what);
	exit(1);
}

static uint8_t *allocate(size_t size)
{
	uint8_t *block = (uint8_t *)malloc(size > 0 ? size : 1);

	if (block == NULL) {
		fail("out of memory");
	}
	return block;
}

/* Every get is tried on every payload; what one takes, put must give back byte by byte. */
#define ROUND_TRIP(name, NAME)                                                                     \
	{                                                                                          \
		struct wire_##name m;                                                              \
                                                                                                   \
		memset(&m, 0, sizeof(m));                                                          \
		if (wire_##name##_get(&m, payload, len)) {                                         \
			uint8_t *again = allocate(len);                                            \
                                                                                                   \
			if (wire_##name##_put(again, &m) != len ||                                 \
			    memcmp(again, payload, len) != 0) {                                    \
				fail(#name ": put does not give back what get took");              \
			}                                                                          \
			free(again);                                                               \
		}                                                                                  \
	}

static void check_payload(const uint8_t *received, size_t len)
{
	uint8_t *payload = allocate(len);

	memcpy(payload, received, len);
	FOR_EACH_MESSAGE(ROUND_TRIP)
	free(payload);
}

static void check_frame(const struct wire_rx *rx)
{
	size_t room = WIRE_FRAME_MAX(rx->payload_len);
	uint8_t *frame = allocate(room);
	size_t size = wire_frame(frame, room, rx->type, rx->seq, wire_rx_payload(rx),
				 rx->payload_len);
	struct wire_rx second;
	bool good = false;

	memset(&second, 0, sizeof(second));
	for (size_t i = 0; i < size; i++) {
		good = wire_rx_byte(&second, frame[i]);
	}
	if (!good || second.type != rx->type || second.seq != rx->seq ||
	    second.payload_len != rx->payload_len ||
	    memcmp(wire_rx_payload(&second), wire_rx_payload(rx), rx->payload_len) != 0) {
		fail("a frame made from a received one is not received as the same");
	}
	if (wire_frame(frame, room - 1, rx->type, rx->seq, wire_rx_payload(rx), rx->payload_len) !=
	    0) {
		fail("wire_frame() wrote into a buffer that is too small");
	}
	free(frame);
}

int main(void)
{
	struct wire_rx rx;
	int byte;

	memset(&rx, 0, sizeof(rx));
	while ((byte = getchar()) != EOF) {
		if (wire_rx_byte(&rx, (uint8_t)byte)) {
			check_payload(wire_rx_payload(&rx), rx.payload_len);
			check_frame(&rx);
		}
	}
	(void)printf("%lu %lu\n", (unsigned long)rx.frames, (unsigned long)rx.rejected);
	return 0;
}
