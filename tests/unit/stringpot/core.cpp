/* SPDX-License-Identifier: Apache-2.0 */
/* The string pot's core behind a C interface, for the tests. */
#include "stringpot_core.h"

using namespace stringpot;

static Queue<8> queue;
static Pacer pacer;
static uint32_t next_conversion;

extern "C" {

size_t pot_line(char *out, uint32_t time_us, uint32_t raw)
{
	char line[LINE_SIZE];
	const size_t n = put_line(line, {time_us, raw});

	for (size_t i = 0; i <= n; i++) {
		out[i] = line[i];
	}
	return n;
}

uint32_t pot_measure(uint32_t first)
{
	next_conversion = first;
	return measure([] { return static_cast<uint16_t>(next_conversion++); });
}

bool pot_push(uint32_t time_us, uint32_t raw)
{
	return queue.push({time_us, raw});
}

bool pot_pop(uint32_t *time_us, uint32_t *raw)
{
	Sample sample = {};
	const bool got = queue.pop(&sample);

	*time_us = sample.time_us;
	*raw = sample.raw;
	return got;
}

uint32_t pot_dropped(void)
{
	return queue.dropped();
}

bool pot_tick(uint32_t pending)
{
	return pacer.tick(pending);
}

uint32_t pot_missed(void)
{
	return pacer.missed();
}

} /* extern "C" */
