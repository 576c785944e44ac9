// SPDX-License-Identifier: Apache-2.0
// A node's serial stream -> its chunks and the raw records of its frames, in one pass.
//
// A chunk is a non-empty run of bytes between two 00; a frame is a chunk that is the stuffed form of
// a message whose CRC is right: hil/wire/frames.py. Nothing here trusts a byte of the stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "column.hpp"

namespace hil::wire {

constexpr size_t kHeaderSize = 3;
constexpr size_t kCrcSize = 2;
// Longer chunks are no frames: it bounds what hostile bytes can cost.
constexpr size_t kChunkLimit = 4096;

// How the payload of one message is laid out: `fixed` bytes, then `count` rows of `row` bytes each.
struct Layout {
	uint8_t id;
	size_t fixed;
	size_t row;        // 0: the message has no group
	size_t max_count;
	size_t count_at;   // where in the payload the rows are counted, little-endian
	size_t count_size; // 1, 2 or 4
};

// All frames of one message, in the stream's order.
struct Found {
	// Per frame: the payload's fixed part, seq u16, position of the frame in the stream i64.
	Column<uint8_t> records;
	// Per row of a group: its bytes, index of its record i64.
	Column<uint8_t> rows;
	int64_t count = 0;
};

struct Stream {
	Column<int64_t> start;  // of each chunk
	Column<int64_t> length; // of each chunk
	Column<int32_t> seq;    // of each chunk: its number, or -1 for one that is no frame
	std::vector<Found> found;    // by layout
	int64_t delimiters = 0;
	int64_t head_end = 0;   // position of the first 00; without one, the end of the stream
	int64_t tail_start = 0; // position behind the last 00; without one, the end of the stream
	int64_t unknown_types = 0;
	int64_t bad_lengths = 0;
};

// CRC-16/IBM-3740, the check value of "123456789" being 0x29B1.
uint16_t crc16(const uint8_t *data, size_t size);

// Layouts must have distinct ids, and rows that are counted within their fixed part.
Stream take_apart(const uint8_t *data, size_t size, const std::vector<Layout> &layouts);

} // namespace hil::wire
