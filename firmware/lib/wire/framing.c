/* SPDX-License-Identifier: Apache-2.0 */
#include "framing.h"

#include <string.h>

/* COBS ends a group at a zero, or, without one, after 254 bytes: that group has the code 0xFF. */
#define COBS_FULL 0xFFu

uint16_t wire_crc16(uint16_t seed, const uint8_t *data, size_t len)
{
	uint32_t crc = seed;

	/* One byte per turn without a table: x^16 + x^12 + x^5 + 1 folds into three shifts. */
	for (size_t i = 0; i < len; i++) {
		uint32_t top = ((crc >> 8) ^ data[i]) & 0xFFu;

		top ^= top >> 4;
		crc = ((crc << 8) ^ (top << 12) ^ (top << 5) ^ top) & 0xFFFFu;
	}
	return (uint16_t)crc;
}

/* Writes stuffed bytes; the code of a group is filled in when the group ends. */
struct stuffer {
	uint8_t *out;
	size_t fill;
	size_t code_at;
	uint8_t code;
};

static void stuffer_open(struct stuffer *s)
{
	s->code_at = s->fill++;
	s->code = 1;
}

static void stuffer_close(struct stuffer *s)
{
	s->out[s->code_at] = s->code;
}

static void stuff(struct stuffer *s, const uint8_t *data, size_t len)
{
	for (size_t i = 0; i < len; i++) {
		/* A full group is closed only when more follows, or the frame would end in a
		 * needless empty group.
		 */
		if (s->code == COBS_FULL) {
			stuffer_close(s);
			stuffer_open(s);
		}
		if (data[i] == 0) {
			stuffer_close(s);
			stuffer_open(s);
		} else {
			s->out[s->fill++] = data[i];
			s->code++;
		}
	}
}

size_t wire_frame(uint8_t *out, size_t out_size, uint8_t type, uint16_t seq, const uint8_t *payload,
		  size_t len)
{
	uint8_t header[WIRE_HEADER_SIZE];
	uint8_t trailer[WIRE_CRC_SIZE];
	struct stuffer s = {out, 1, 0, 0};
	uint16_t crc;

	/* The first comparison keeps the sum in the second from wrapping. */
	if (len > out_size || out_size < WIRE_FRAME_MAX(len)) {
		return 0;
	}
	wire_put_u8(header, type);
	wire_put_u16(header + 1, seq);
	crc = wire_crc16(WIRE_CRC_SEED, header, sizeof(header));
	crc = wire_crc16(crc, payload, len);
	wire_put_u16(trailer, crc);

	out[0] = 0;
	stuffer_open(&s);
	stuff(&s, header, sizeof(header));
	stuff(&s, payload, len);
	stuff(&s, trailer, sizeof(trailer));
	stuffer_close(&s);
	out[s.fill++] = 0;
	return s.fill;
}

static void rx_zero(struct wire_rx *rx)
{
	if (rx->fill < sizeof(rx->buffer)) {
		rx->buffer[rx->fill++] = 0;
	} else {
		rx->overflowed = true;
	}
}

static void rx_run(struct wire_rx *rx, const uint8_t *data, size_t len)
{
	size_t room = sizeof(rx->buffer) - rx->fill;

	if (len > room) {
		rx->overflowed = true;
		len = room;
	}
	memcpy(rx->buffer + rx->fill, data, len);
	rx->fill += len;
}

static bool rx_is_frame(const struct wire_rx *rx)
{
	size_t covered;

	if (rx->left != 0 || rx->overflowed || rx->fill < WIRE_HEADER_SIZE + WIRE_CRC_SIZE) {
		return false;
	}
	covered = rx->fill - WIRE_CRC_SIZE;
	return wire_crc16(WIRE_CRC_SEED, rx->buffer, covered) == wire_get_u16(rx->buffer + covered);
}

static bool rx_delimiter(struct wire_rx *rx)
{
	/* Nothing is taken before the first 00: the chunk that it ends is empty. */
	bool empty = rx->code == 0;
	bool good = !empty && rx_is_frame(rx);

	if (good) {
		rx->frames++;
		rx->type = rx->buffer[0];
		rx->seq = wire_get_u16(rx->buffer + 1);
		rx->payload_len = rx->fill - WIRE_HEADER_SIZE - WIRE_CRC_SIZE;
	} else if (!empty) {
		rx->rejected++;
	}
	rx->fill = 0;
	rx->code = 0;
	rx->left = 0;
	rx->overflowed = false;
	rx->delimited = true;
	return good;
}

/* Takes apart bytes without a delimiter: groups, whose first and last may be cut. */
static void rx_groups(struct wire_rx *rx, const uint8_t *data, size_t len)
{
	while (len > 0) {
		size_t run = len < rx->left ? len : rx->left;

		if (run > 0) {
			rx_run(rx, data, run);
			rx->left = (uint8_t)(rx->left - run);
		} else {
			/* A group stands for the zero behind it, unless it is full or the last. */
			if (rx->code != 0 && rx->code != COBS_FULL) {
				rx_zero(rx);
			}
			rx->code = *data;
			rx->left = (uint8_t)(rx->code - 1u);
			run = 1;
		}
		data += run;
		len -= run;
	}
}

size_t wire_rx_take(struct wire_rx *rx, const uint8_t *data, size_t len, bool *good)
{
	size_t at = 0;

	*good = false;
	while (at < len && !*good) {
		const uint8_t *end = (const uint8_t *)memchr(data + at, 0, len - at);
		size_t chunk = end != NULL ? (size_t)(end - data) - at : len - at;

		if (rx->delimited) {
			rx_groups(rx, data + at, chunk);
		}
		at += chunk;
		if (end != NULL) {
			*good = rx_delimiter(rx);
			at++;
		}
	}
	return at;
}
