/* SPDX-License-Identifier: Apache-2.0 */
/* The golden vectors of the protocol, worked out by hand, through the code of the nodes. */
#include <string.h>

#include <zephyr/ztest.h>

#include "framing.h"
#include "messages.h"

#define VECTOR_MAX WIRE_FRAME_MAX(WIRE_MAX_PAYLOAD_SIZE)

struct vector {
	const char *name;
	uint8_t type;
	uint16_t seq;
	size_t payload_len;
	size_t frame_len;
	uint8_t payload[WIRE_MAX_PAYLOAD_SIZE];
	uint8_t frame[VECTOR_MAX];
};

static const struct vector vectors[] = {
#include "golden.inc"
};

/* Decode @p payload as a message of @p type and encode it again. @return bytes, 0 when refused. */
static size_t recode(uint8_t type, const uint8_t *payload, size_t len, uint8_t *out)
{
	switch (type) {
#define RECODE(message, MESSAGE)                                                                   \
	case WIRE_##MESSAGE##_ID: {                                                                \
		static struct wire_##message m;                                                    \
                                                                                                   \
		return wire_##message##_get(&m, payload, len) ? wire_##message##_put(out, &m) : 0; \
	}
		FOR_EACH_MESSAGE(RECODE)
	default:
		return 0;
	}
}

ZTEST_SUITE(wire, NULL, NULL, NULL, NULL, NULL);

ZTEST(wire, test_every_message_has_a_vector)
{
#define HAS_VECTOR(message, MESSAGE)                                                               \
	{                                                                                          \
		bool found = false;                                                                \
                                                                                                   \
		for (size_t i = 0; i < ARRAY_SIZE(vectors); i++) {                                 \
			found = found || vectors[i].type == WIRE_##MESSAGE##_ID;                   \
		}                                                                                  \
		zexpect_true(found, #message);                                                     \
	}
	FOR_EACH_MESSAGE(HAS_VECTOR)
}

ZTEST(wire, test_payloads_decode_and_encode_to_the_same_bytes)
{
	for (size_t i = 0; i < ARRAY_SIZE(vectors); i++) {
		const struct vector *v = &vectors[i];
		uint8_t out[WIRE_MAX_PAYLOAD_SIZE];

		zexpect_equal(recode(v->type, v->payload, v->payload_len, out), v->payload_len,
			      "%s", v->name);
		zexpect_mem_equal(out, v->payload, v->payload_len, "%s", v->name);
	}
}

ZTEST(wire, test_frames)
{
	for (size_t i = 0; i < ARRAY_SIZE(vectors); i++) {
		const struct vector *v = &vectors[i];
		uint8_t out[VECTOR_MAX];

		zexpect_equal(wire_frame(out, sizeof(out), v->type, v->seq, v->payload,
					 v->payload_len),
			      v->frame_len, "%s", v->name);
		zexpect_mem_equal(out, v->frame, v->frame_len, "%s", v->name);
	}
}

ZTEST(wire, test_receiver)
{
	static struct wire_rx rx;
	uint32_t good = 0;

	memset(&rx, 0, sizeof(rx));
	for (size_t i = 0; i < ARRAY_SIZE(vectors); i++) {
		const struct vector *v = &vectors[i];

		for (size_t at = 0; at < v->frame_len; at++) {
			bool ended;

			zexpect_equal(wire_rx_take(&rx, v->frame + at, 1, &ended), 1);
			if (!ended) {
				continue;
			}
			good++;
			zexpect_equal(rx.type, v->type, "%s", v->name);
			zexpect_equal(rx.seq, v->seq, "%s", v->name);
			zexpect_equal(rx.payload_len, v->payload_len, "%s", v->name);
			zexpect_mem_equal(wire_rx_payload(&rx), v->payload, v->payload_len, "%s",
					  v->name);
		}
	}
	zexpect_equal(good, ARRAY_SIZE(vectors));
	zexpect_equal(rx.rejected, 0);
}

ZTEST(wire, test_every_cut_and_every_flipped_bit_is_refused)
{
	for (size_t i = 0; i < ARRAY_SIZE(vectors); i++) {
		const struct vector *v = &vectors[i];

		for (size_t flipped = 8; flipped < 8 * (v->frame_len - 1); flipped++) {
			static struct wire_rx rx;
			uint8_t line[VECTOR_MAX];
			bool good;

			memset(&rx, 0, sizeof(rx));
			memcpy(line, v->frame, v->frame_len);
			line[flipped / 8] ^= (uint8_t)(1U << flipped % 8);
			zassert_equal(wire_rx_take(&rx, line, v->frame_len, &good), v->frame_len,
				      "%s, bit %zu", v->name, flipped);
			zassert_false(good, "%s, bit %zu", v->name, flipped);
		}
		for (size_t len = 0; len < v->payload_len; len++) {
			uint8_t out[WIRE_MAX_PAYLOAD_SIZE];

			zexpect_equal(recode(v->type, v->payload, len, out), 0, "%s, %zu bytes",
				      v->name, len);
		}
	}
}
