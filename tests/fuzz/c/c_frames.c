/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The C decoder of frames and of every message.
 *
 * The lowest bit of the first byte says what the rest is: the bytes on the line or, parted by
 * FF FE, type, seq and payload of messages that are framed here with a right CRC.
 */
#include "check.h"
#include "framing.h"
#include "messages.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* What was read is written back byte for byte. Buffers are exactly as long as they may be used. */
#define CHECK_MESSAGE(name, NAME)                                                                  \
	if (type == WIRE_##NAME##_ID) {                                                            \
		static struct wire_##name message;                                                 \
		uint8_t *copy = malloc(len + 1U);                                                  \
                                                                                                   \
		CHECK(copy != NULL);                                                               \
		if (wire_##name##_get(&message, payload, len)) {                                   \
			CHECK(wire_##name##_put(copy, &message) == len);                           \
			CHECK(memcmp(copy, payload, len) == 0);                                    \
		}                                                                                  \
		free(copy);                                                                        \
	}

static void check_message(uint8_t type, const uint8_t *bytes, size_t len)
{
	uint8_t *payload = malloc(len != 0U ? len : 1U);

	CHECK(payload != NULL);
	memcpy(payload, bytes, len);
	FOR_EACH_MESSAGE(CHECK_MESSAGE)
	free(payload);
}

/* Framed again, it is taken again, as the same message. */
static void check_frame(const struct wire_rx *rx)
{
	uint8_t line[WIRE_FRAME_MAX(WIRE_RX_PAYLOAD_MAX)];
	struct wire_rx again;
	size_t size;
	bool taken;

	CHECK(rx->payload_len <= WIRE_RX_PAYLOAD_MAX);
	size = wire_frame(line, sizeof(line), rx->type, rx->seq, wire_rx_payload(rx),
			  rx->payload_len);
	CHECK(size >= WIRE_FRAME_OVERHEAD && size <= sizeof(line));
	memset(&again, 0, sizeof(again));
	for (size_t i = 0; i < size; i++) {
		CHECK((line[i] == 0U) == (i == 0U || i == size - 1U));
	}
	CHECK(wire_rx_take(&again, line, size, &taken) == size);
	CHECK(taken && again.type == rx->type && again.seq == rx->seq);
	CHECK(again.payload_len == rx->payload_len);
	CHECK(memcmp(wire_rx_payload(&again), wire_rx_payload(rx), rx->payload_len) == 0);
}

/* As many bytes, one by one, leave the receiver in the same state. */
static void check_bytewise(struct wire_rx *before, const struct wire_rx *after,
			   const uint8_t *line, size_t size, bool good)
{
	bool ended = false;

	for (size_t i = 0; i < size; i++) {
		CHECK(!ended);
		CHECK(wire_rx_take(before, line + i, 1, &ended) == 1U);
	}
	CHECK(ended == good);
	CHECK(memcmp(before, after, sizeof(*after)) == 0);
}

static void take(struct wire_rx *rx, const uint8_t *line, size_t size)
{
	for (size_t at = 0; at < size;) {
		struct wire_rx before = *rx;
		bool good;
		size_t taken = wire_rx_take(rx, line + at, size - at, &good);

		CHECK(taken > 0U && taken <= size - at);
		check_bytewise(&before, rx, line + at, taken, good);
		at += taken;
		CHECK(good || at == size);
		if (good) {
			CHECK(line[at - 1U] == 0U);
			check_frame(rx);
			check_message(rx->type, wire_rx_payload(rx), rx->payload_len);
		}
	}
}

static void take_part(struct wire_rx *rx, const uint8_t *part, size_t size)
{
	uint8_t line[WIRE_FRAME_MAX(WIRE_RX_PAYLOAD_MAX + 8U)];
	size_t framed = 0;

	if (size >= WIRE_HEADER_SIZE) {
		framed = wire_frame(line, sizeof(line), part[0], wire_get_u16(part + 1),
				    part + WIRE_HEADER_SIZE, size - WIRE_HEADER_SIZE);
	}
	if (framed != 0U) {
		const uint32_t before = rx->frames;

		take(rx, line, framed);
		/* Its first 00 may have ended another one before it. */
		CHECK(size - WIRE_HEADER_SIZE > WIRE_RX_PAYLOAD_MAX || rx->frames - before >= 1U);
	} else {
		take(rx, part, size);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct wire_rx rx;
	size_t first = 1;

	memset(&rx, 0, sizeof(rx));
	if (size == 0U) {
		return 0;
	}
	if ((data[0] & 1U) == 0U) {
		take(&rx, data + 1, size - 1U);
		return 0;
	}
	for (size_t i = 1; i <= size; i++) {
		if (i == size || (i + 1U < size && data[i] == 0xFFU && data[i + 1U] == 0xFEU)) {
			take_part(&rx, data + first, i - first);
			first = i + 2U;
			i++;
		}
	}
	return 0;
}
