// SPDX-License-Identifier: Apache-2.0
// What callgrind counts: `instructions step N` runs N steps of the estimator, `instructions decode N`
// takes 1,000 frames apart N times. Twice N minus N is the work alone, without the program's own start.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "estimator.hpp"
#include "streams.hpp"

namespace
{

// A bar that lies still for 4 s, then swings: alignment, stillness and motion in turn.
bv::Sample<float> sample(int k, float phase)
{
	const float t = static_cast<float>(k) / 416.0F;
	const bool still = k % 4160 < 1664;
	bv::Sample<float> s;

	s.t_ticks = static_cast<int64_t>(k) * 38462 + 16000000;
	s.accel_mps2 = {0.02F * std::sin(97.0F * t + phase), 0.02F * std::cos(89.0F * t),
			9.81F + (still ? 0.0F : 3.0F * std::sin(6.0F * t))};
	s.gyro_radps = {still ? 0.0F : 0.3F * std::sin(5.0F * t + phase), 0.0F, 0.0F};
	return s;
}

int step(int n)
{
	bv::Estimator<float> estimator{bv::Params<float>()};
	bv::Output<float> output;
	int statuses = 0;

	for (int k = 0; k < n; k++) {
		const bv::Sample<float> follower = sample(k, 0.5F);

		statuses += static_cast<int>(
			estimator.step(sample(k, 0.0F), &follower, 1, output));
	}
	return statuses;
}

// Frames of 36 bytes of payload, as captures and pairs have, with two zeros each.
bool decode(int n)
{
	constexpr int kFrames = 1000;
	std::vector<uint8_t> stream;

	for (int k = 0; k < kFrames; k++) {
		uint8_t message[3 + 36 + 2];
		for (size_t i = 0; i < sizeof(message); i++) {
			message[i] = static_cast<uint8_t>(1 + (static_cast<size_t>(k) * 31 + i) % 255);
		}
		message[0] = 7;
		message[10] = message[20] = 0;
		const uint16_t crc = hil::wire::crc16(message, 39);
		message[39] = static_cast<uint8_t>(crc);
		message[40] = static_cast<uint8_t>(crc >> 8);
		stream.push_back(0);
		size_t code = stream.size();
		stream.push_back(1);
		for (const uint8_t byte : message) {
			if (byte) {
				stream.push_back(byte);
				stream[code]++;
			} else {
				code = stream.size();
				stream.push_back(1);
			}
		}
		stream.push_back(0);
	}
	for (int k = 0; k < n; k++) {
		const auto found =
			hil::wire::take_apart(stream.data(), stream.size(), {{7, 36, 0, 0, 0, 0}});
		if (found.found[0].count != kFrames) {
			return false;
		}
	}
	return true;
}

} // namespace

int main(int argc, char **argv)
{
	if (argc != 3) {
		return 2;
	}
	const int n = std::atoi(argv[2]);

	if (!std::strcmp(argv[1], "decode")) {
		return decode(n) ? 0 : 1;
	}
	std::printf("%d\n", step(n));
	return 0;
}
