// SPDX-License-Identifier: Apache-2.0
// Takes the stream on standard input apart with the layouts of the arguments, each
// id,fixed,row,max_count,count_at,count_size; prints chunks, frames, unknown types, bad lengths.
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <vector>

#include "streams.hpp"

int main(int argc, char **argv)
{
	std::vector<hil::wire::Layout> layouts;
	std::vector<uint8_t> data;
	uint8_t block[4096];

	for (int i = 1; i < argc; i++) {
		unsigned id;
		size_t fixed, row, max_count, count_at, count_size;
		if (std::sscanf(argv[i], "%u,%zu,%zu,%zu,%zu,%zu", &id, &fixed, &row, &max_count,
				&count_at, &count_size) != 6) {
			return 2;
		}
		layouts.push_back({static_cast<uint8_t>(id), fixed, row, max_count, count_at, count_size});
	}
	while (const size_t got = std::fread(block, 1, sizeof(block), stdin)) {
		data.insert(data.end(), block, block + got);
	}
	// Exactly as large as it is, so that a byte too far is seen.
	data.shrink_to_fit();
	const auto found = hil::wire::take_apart(data.data(), data.size(), layouts);
	const auto frames = std::count_if(found.seq.data(), found.seq.data() + found.seq.size(),
					  [](int32_t seq) { return seq >= 0; });
	std::printf("%zu %td %lld %lld\n", found.start.size(), frames,
		    static_cast<long long>(found.unknown_types),
		    static_cast<long long>(found.bad_lengths));
	return 0;
}
