/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The parts of the string pot's firmware that need no ESP32: pacing, averaging, queue, lines.
 *
 * C++11, no heap, no library but <atomic>; compiled and tested on the host.
 */
#ifndef STRINGPOT_CORE_H_
#define STRINGPOT_CORE_H_

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace stringpot {

constexpr uint32_t PERIOD_US = 1000;

/** Conversions summed for one sample: their sum is sent, so that their noise adds resolution. */
constexpr unsigned OVERSAMPLE = 4;

/** Longest line, "4294967295,16777216\r\n", and its closing zero. */
constexpr size_t LINE_SIZE = 24;

struct Sample {
	uint32_t time_us;
	uint32_t raw;
};

/**
 * Whether a tick of the timer came in time for its sample. Ticks that are announced while the
 * sample before is still being taken cannot be made good: they are counted, and their time is
 * missing from the lines, which is how the host sees them.
 */
class Pacer {
public:
	/**
	 * @param pending ticks since the last call, the current one included
	 * @return whether there is a sample to take
	 */
	bool tick(uint32_t pending)
	{
		if (pending == 0) {
			return false;
		}
		missed_ += pending - 1;
		return true;
	}

	uint32_t missed() const { return missed_; }

private:
	uint32_t missed_ = 0;
};

/**
 * Queue between the sampler and the line writer, one task each; holds SIZE - 1 samples.
 *
 * @tparam SIZE a power of two
 */
template <size_t SIZE> class Queue {
	static_assert(SIZE >= 2 && (SIZE & (SIZE - 1)) == 0, "a power of two");

public:
	/** @return false when it is full: the sample is dropped and counted */
	bool push(const Sample &sample)
	{
		const size_t head = head_.load(std::memory_order_relaxed);
		const size_t next = (head + 1) & (SIZE - 1);

		if (next == tail_.load(std::memory_order_acquire)) {
			dropped_.store(dropped_.load(std::memory_order_relaxed) + 1,
				       std::memory_order_relaxed);
			return false;
		}
		samples_[head] = sample;
		head_.store(next, std::memory_order_release);
		return true;
	}

	/** @return false when it is empty */
	bool pop(Sample *sample)
	{
		const size_t tail = tail_.load(std::memory_order_relaxed);

		if (tail == head_.load(std::memory_order_acquire)) {
			return false;
		}
		*sample = samples_[tail];
		tail_.store((tail + 1) & (SIZE - 1), std::memory_order_release);
		return true;
	}

	uint32_t dropped() const { return dropped_.load(std::memory_order_relaxed); }

private:
	Sample samples_[SIZE] = {};
	std::atomic<size_t> head_{0};
	std::atomic<size_t> tail_{0};
	std::atomic<uint32_t> dropped_{0};
};

/** Sum of OVERSAMPLE conversions; @p convert gives one. */
template <typename Convert> uint32_t measure(Convert convert)
{
	uint32_t sum = 0;

	for (unsigned i = 0; i < OVERSAMPLE; i++) {
		sum += static_cast<uint32_t>(convert());
	}
	return sum;
}

/** Decimal digits of @p value at @p out; returns how many. */
inline size_t put_number(char *out, uint32_t value)
{
	char digits[10];
	size_t n = 0;

	do {
		digits[n++] = static_cast<char>('0' + value % 10);
		value /= 10;
	} while (value != 0);
	for (size_t i = 0; i < n; i++) {
		out[i] = digits[n - 1 - i];
	}
	return n;
}

/** "time_us,raw_adc" and CR LF; returns the length without the closing zero. */
inline size_t put_line(char (&out)[LINE_SIZE], const Sample &sample)
{
	size_t n = put_number(out, sample.time_us);

	out[n++] = ',';
	n += put_number(out + n, sample.raw);
	out[n++] = '\r';
	out[n++] = '\n';
	out[n] = '\0';
	return n;
}

} /* namespace stringpot */

#endif /* STRINGPOT_CORE_H_ */
