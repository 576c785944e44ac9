/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Framing of the serial line: 00 <COBS(type u8, seq u16, payload, crc16)> 00.
 *
 * Integers are little-endian. The CRC covers type, seq and payload. COBS (Cheshire and Baker,
 * IEEE/ACM Transactions on Networking 7(2), 1999) takes every 00 out of the frame, so a 00 always
 * delimits; plain ASCII lines, which hold no 00 either, may stand between frames.
 *
 * seq starts at 0 at boot and counts every frame given to the line, dropped ones too, modulo 2^16:
 * that is what makes each loss countable at the other end. The first frame after boot is HELLO.
 *
 * Pure C11 (and C++17), no dependencies but wire.h; nothing here blocks, allocates or keeps hidden
 * state, so it may run in an interrupt.
 */
#ifndef WIRE_FRAMING_H_
#define WIRE_FRAMING_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

#define WIRE_HEADER_SIZE 3u /* type u8, seq u16 */
#define WIRE_CRC_SIZE    2u
#define WIRE_CRC_SEED    0xFFFFu

/* Bytes of a frame that are not payload: two delimiters, header, CRC; COBS codes come on top. */
#define WIRE_FRAME_OVERHEAD (2u + WIRE_HEADER_SIZE + WIRE_CRC_SIZE)

/* COBS adds one byte per started run of 254. */
#define WIRE_COBS_MAX(n) ((n) + ((n) + 253u) / 254u)

/* Largest frame, delimiters included, that a payload of len bytes can make. */
#define WIRE_FRAME_MAX(len) (2u + WIRE_COBS_MAX((len) + WIRE_HEADER_SIZE + WIRE_CRC_SIZE))

/* Largest payload that wire_rx_take() takes; longer frames are rejected. */
#ifndef WIRE_RX_PAYLOAD_MAX
#define WIRE_RX_PAYLOAD_MAX WIRE_MAX_PAYLOAD_SIZE
#endif

/*
 * CRC-16/IBM-3740 (also called CCITT-FALSE): polynomial 0x1021, not reflected, no final XOR.
 * Start with WIRE_CRC_SEED; the result of one call is the seed of the next.
 */
uint16_t wire_crc16(uint16_t seed, const uint8_t *data, size_t len);

/*
 * Writes one whole frame, both delimiters included, to out. Returns its size, or 0 when out_size is
 * below WIRE_FRAME_MAX(len). payload may be NULL when len is 0; it must not overlap out.
 */
size_t wire_frame(uint8_t *out, size_t out_size, uint8_t type, uint16_t seq, const uint8_t *payload,
		  size_t len);

/* Receiver of frames. All zero is its initial state. */
struct wire_rx {
	/* The frame, valid from the moment that wire_rx_take() says so until its next call. */
	uint8_t type;
	uint16_t seq;
	size_t payload_len;

	/* Counters since the start; they wrap. */
	uint32_t frames;   /* good frames */
	uint32_t rejected; /* non-empty chunks between two 00 that were no good frame, text too */

	/* Private. */
	uint8_t buffer[WIRE_HEADER_SIZE + WIRE_RX_PAYLOAD_MAX + WIRE_CRC_SIZE];
	size_t fill;     /* bytes in buffer */
	uint8_t code;    /* of the current COBS group; 0 before the first group of a chunk */
	uint8_t left;    /* bytes still to come in the group */
	bool delimited;  /* a 00 has been seen: what follows may be a frame */
	bool overflowed; /* the chunk is longer than any frame that is taken */
};

/*
 * Takes bytes from the line, up to the end of the first good frame or all of them. Returns how many
 * were taken; *good says whether the last of them ended a good frame. Call again for the rest.
 */
size_t wire_rx_take(struct wire_rx *rx, const uint8_t *data, size_t len, bool *good);

/* Payload of the frame just received: rx->payload_len bytes, valid until the next call. */
static inline const uint8_t *wire_rx_payload(const struct wire_rx *rx)
{
	return rx->buffer + WIRE_HEADER_SIZE;
}

#ifdef __cplusplus
}
#endif

#endif /* WIRE_FRAMING_H_ */
