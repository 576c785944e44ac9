// SPDX-License-Identifier: Apache-2.0
// What the firmware does most on a Cortex-M4F, beside what one would write instead: each is run
// once between two readings of the clock, and both must come to the same. firmware/pil counts the
// estimator's step the same way.
#include <cstdint>
#include <cstring>

#include "clock.hpp"
#include "framing.h"
#include "lsm6dsox_decoder.h"
#include "semihost.hpp"
#include "types.hpp"

namespace
{

constexpr std::size_t PAYLOAD = 128;
constexpr std::size_t PAIRS = 16;

using Covariance = Eigen::Matrix<float, 15, 15>;

std::uint8_t payload[PAYLOAD];
std::uint8_t framed[WIRE_FRAME_MAX(PAYLOAD)];
std::uint8_t framed_plainly[WIRE_FRAME_MAX(PAYLOAD)];
std::uint8_t words[2 * PAIRS * LSM6DSOX_WORD_SIZE];
std::uint16_t table[256];
wire_rx receiver;
lsm6dsox_decoder decoder;
lsm6dsox_pair pairs[PAIRS + 2];
lsm6dsox_pair pairs_plainly[PAIRS];
Covariance P, F, Q;

void tell(const char *name, std::uint32_t ticks)
{
	char digits[12] = "          \n";
	char *digit = digits + 9;

	do {
		*digit-- = static_cast<char>('0' + ticks % 10);
		ticks /= 10;
	} while (ticks > 0);
	semihost::print("target: ");
	semihost::print(name);
	semihost::print(" ");
	semihost::print(digits);
}

template <class Work> void count(const char *name, Work work)
{
	const std::uint32_t begin = pil_clock::now();

	// Nothing that reads or writes memory may move out from between the readings.
	asm volatile("" ::: "memory");
	work();
	asm volatile("" ::: "memory");
	tell(name, pil_clock::between(begin, pil_clock::now()));
}

void demand(bool holds, const char *what)
{
	if (!holds) {
		semihost::print("target: wrong: ");
		semihost::print(what);
		semihost::print("\n");
		semihost::exit(2);
	}
}

/// CRC-16/IBM-3740 bit by bit: what fills the table.
[[gnu::noinline]] std::uint16_t crc_by_bits(std::uint16_t crc, const std::uint8_t *data,
					    std::size_t size)
{
	for (std::size_t i = 0; i < size; i++) {
		crc = static_cast<std::uint16_t>(crc ^ (data[i] << 8));
		for (int bit = 0; bit < 8; bit++) {
			crc = static_cast<std::uint16_t>(crc & 0x8000U ? (crc << 1) ^ 0x1021U
								       : crc << 1);
		}
	}
	return crc;
}

/// The same by a table of 512 B: the least that is known for a byte at a time.
[[gnu::noinline]] std::uint16_t crc_by_table(std::uint16_t seed, const std::uint8_t *data,
					     std::size_t size)
{
	std::uint32_t crc = seed;

	for (const std::uint8_t *end = data + size; data < end; data++) {
		crc = ((crc << 8) ^ table[((crc >> 8) ^ *data) & 0xFFU]) & 0xFFFFU;
	}
	return static_cast<std::uint16_t>(crc);
}

/// A whole frame by hand: header, payload and CRC copied once, zeros turned to distances in place.
/// For frames of less than 254 bytes, which need no second kind of group.
[[gnu::noinline]] std::size_t frame_by_hand(std::uint8_t *out, std::uint8_t type, std::uint16_t seq,
					    const std::uint8_t *data, std::size_t size)
{
	std::uint8_t *const body = out + 2;
	std::size_t fill = WIRE_HEADER_SIZE + size;
	std::size_t code_at = 1;

	body[0] = type;
	wire_put_u16(body + 1, seq);
	std::memcpy(body + WIRE_HEADER_SIZE, data, size);
	wire_put_u16(body + fill, crc_by_table(WIRE_CRC_SEED, body, fill));
	fill += WIRE_CRC_SIZE;
	out[0] = 0;
	for (std::size_t i = 2; i < fill + 2; i++) {
		if (out[i] == 0) {
			out[code_at] = static_cast<std::uint8_t>(i - code_at);
			code_at = i;
		}
	}
	out[code_at] = static_cast<std::uint8_t>(fill + 2 - code_at);
	out[fill + 2] = 0;
	return fill + 3;
}

/// Of a whole frame that lies in memory: COBS undone in place, CRC checked.
[[gnu::noinline]] bool take_by_hand(std::uint8_t *frame, std::size_t size)
{
	std::size_t code_at = 1;
	const std::size_t end = size - 1;

	while (code_at + frame[code_at] < end) {
		const std::size_t next = code_at + frame[code_at];

		frame[code_at] = 0;
		code_at = next;
	}
	frame[code_at] = 0;
	const std::size_t covered = size - 3 - WIRE_CRC_SIZE;

	return crc_by_table(WIRE_CRC_SEED, frame + 2, covered) == wire_get_u16(frame + 2 + covered);
}

/// Words in pairs, gyroscope first, with the tag's parity looked at and nothing ever missing.
[[gnu::noinline]] std::size_t pairs_by_hand(const std::uint8_t *word, std::size_t count,
					    lsm6dsox_pair *out)
{
	std::size_t n = 0;

	for (std::size_t i = 0; i < count; i++, word += LSM6DSOX_WORD_SIZE) {
		std::uint32_t parity = word[0];

		parity ^= parity >> 4;
		parity ^= parity >> 2;
		parity ^= parity >> 1;
		if ((parity & 1U) != 0U) {
			continue;
		}
		if (word[0] >> 3 == LSM6DSOX_TAG_GYRO) {
			std::memcpy(out[n].gyro_lsb, word + 1, 6);
		} else if (word[0] >> 3 == LSM6DSOX_TAG_ACCEL) {
			std::memcpy(out[n].accel_lsb, word + 1, 6);
			out[n].slot = static_cast<std::uint32_t>(n);
			n++;
		}
	}
	return n;
}

[[gnu::noinline]] void predict_densely()
{
	const Covariance left = F * P;

	P = left * F.transpose() + Q;
}

void fill()
{
	std::uint32_t noise = 1;

	for (std::uint8_t &byte : payload) {
		noise = noise * 1664525U + 1013904223U;
		byte = static_cast<std::uint8_t>(noise >> 24);
	}
	for (unsigned i = 0; i < 256; i++) {
		const auto byte = static_cast<std::uint8_t>(i);

		table[i] = crc_by_bits(0, &byte, 1);
	}
	for (unsigned i = 0; i < 2 * PAIRS; i++) {
		std::uint8_t *const word = words + i * LSM6DSOX_WORD_SIZE;
		const unsigned sensor = i % 2 == 0 ? LSM6DSOX_TAG_GYRO : LSM6DSOX_TAG_ACCEL;
		const unsigned tag = sensor << 3 | (i / 2 % LSM6DSOX_SLOT_MODULUS) << 1;

		word[0] = static_cast<std::uint8_t>(
			tag | (static_cast<unsigned>(__builtin_popcount(tag)) & 1U));
		std::memcpy(word + 1, payload + i, 6);
	}
	P.setIdentity();
	Q.setIdentity();
	F.setIdentity();
	F.block<3, 3>(0, 3).setConstant(0.0024f);
	F.block<3, 6>(3, 6).setConstant(0.01f);
	F.block<3, 3>(6, 12).setConstant(0.0024f);
}

void wires()
{
	volatile std::uint16_t crc[3];
	std::size_t size = 0, size_plainly = 0;
	bool good = false, good_plainly = false;

	count("crc", [&] { crc[0] = wire_crc16(WIRE_CRC_SEED, payload, PAYLOAD); });
	count("crc_table", [&] { crc[1] = crc_by_table(WIRE_CRC_SEED, payload, PAYLOAD); });
	count("crc_bits", [&] { crc[2] = crc_by_bits(WIRE_CRC_SEED, payload, PAYLOAD); });
	demand(crc[0] == crc[1] && crc[0] == crc[2], "crc");
	count("frame", [&] { size = wire_frame(framed, sizeof(framed), 7, 9, payload, PAYLOAD); });
	count("frame_hand",
	      [&] { size_plainly = frame_by_hand(framed_plainly, 7, 9, payload, PAYLOAD); });
	demand(size == size_plainly && std::memcmp(framed, framed_plainly, size) == 0, "frame");
	count("take", [&] { wire_rx_take(&receiver, framed, size, &good); });
	count("take_hand", [&] { good_plainly = take_by_hand(framed_plainly, size); });
	demand(good && good_plainly &&
		       std::memcmp(wire_rx_payload(&receiver), framed_plainly + 5, PAYLOAD) == 0,
	       "take");
}

void fifo()
{
	std::size_t n = 0;

	lsm6dsox_decoder_init(&decoder, 0);
	// The first burst finds its place in the numbering; the second is what all others are.
	demand(lsm6dsox_decoder_push(&decoder, words, sizeof(words), 0, pairs).pairs == PAIRS,
	       "fifo");
	count("fifo", [&] { lsm6dsox_decoder_push(&decoder, words, sizeof(words), 0, pairs); });
	count("fifo_hand", [&] { n = pairs_by_hand(words, 2 * PAIRS, pairs_plainly); });
	demand(n == PAIRS, "fifo by hand");
	for (std::size_t i = 0; i < PAIRS; i++) {
		demand(std::memcmp(pairs[i].gyro_lsb, pairs_plainly[i].gyro_lsb, 12) == 0,
		       "pairs");
	}
}

} // namespace

int main()
{
	pil_clock::start();
	tell("known", pil_clock::known<1000>());
	fill();
	wires();
	fifo();
	count("predict_dense", predict_densely);
	return 0;
}
