/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Feeds standard input to wire_rx_take() and does with each good frame all that can be done with
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
	bool good;

	memset(&second, 0, sizeof(second));
	if (wire_rx_take(&second, frame, size, &good) != size || !good ||
	    second.type != rx->type || second.seq != rx->seq ||
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

/* What comes in pieces is received as what comes byte by byte. */
static void check_bytes(const struct wire_rx *rx, struct wire_rx *bytewise, const uint8_t *data,
			size_t len, bool good)
{
	bool ended = false;

	for (size_t i = 0; i < len; i++) {
		if (ended || wire_rx_take(bytewise, data + i, 1, &ended) != 1) {
			fail("a byte was not taken, or not the last one ended a frame");
		}
	}
	if (ended != good || memcmp(rx, bytewise, sizeof(*rx)) != 0) {
		fail("what comes in pieces is not received as what comes byte by byte");
	}
}

int main(void)
{
	struct wire_rx rx, bytewise;
	size_t room = 1;
	size_t size;
	uint8_t *piece;

	memset(&rx, 0, sizeof(rx));
	memset(&bytewise, 0, sizeof(bytewise));
	do {
		/* Pieces of 1 to 96 bytes, in an order without a pattern. */
		room = room * 5 % 97;
		piece = allocate(room);
		size = fread(piece, 1, room, stdin);
		for (size_t at = 0; at < size;) {
			bool good;
			size_t taken = wire_rx_take(&rx, piece + at, size - at, &good);

			check_bytes(&rx, &bytewise, piece + at, taken, good);
			if (good) {
				check_payload(wire_rx_payload(&rx), rx.payload_len);
				check_frame(&rx);
			}
			at += taken;
		}
		free(piece);
	} while (size == room);
	(void)printf("%lu %lu\n", (unsigned long)rx.frames, (unsigned long)rx.rejected);
	return 0;
}
