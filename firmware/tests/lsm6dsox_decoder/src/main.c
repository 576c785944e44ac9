/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The FIFO decoder on the target's own compiler, with words worked out by hand. The random tests
 * run on the host, in tests/unit/test_lsm6dsox_decoder.py.
 */
#include <string.h>

#include <zephyr/ztest.h>

#include "lsm6dsox_decoder.h"

/* Tags of slot counters 0 to 3, parity included. */
static const uint8_t gyro_tag[4] = {0x09, 0x0A, 0x0C, 0x0F};
static const uint8_t accel_tag[4] = {0x11, 0x12, 0x14, 0x17};

#define SLOTS 24U
#define WORDS (2U * SLOTS)

static uint8_t words[WORDS * LSM6DSOX_WORD_SIZE];
static struct lsm6dsox_pair pairs[SLOTS + 2U];
static struct lsm6dsox_decoder decoder;

/* The word's number in its data bytes, so that a pair tells where it comes from. */
static void fill_words(void)
{
	for (uint32_t i = 0; i < WORDS; i++) {
		uint8_t *word = &words[i * LSM6DSOX_WORD_SIZE];

		memset(word, 0, LSM6DSOX_WORD_SIZE);
		word[0] = i % 2U == 0U ? gyro_tag[(i / 2U) % 4U] : accel_tag[(i / 2U) % 4U];
		word[1] = (uint8_t)i;
	}
}

static struct lsm6dsox_burst push(uint32_t first, uint32_t count)
{
	return lsm6dsox_decoder_push(&decoder, &words[first * LSM6DSOX_WORD_SIZE],
				     count * LSM6DSOX_WORD_SIZE, 0, pairs);
}

static void expect_pair(size_t index, uint32_t slot, uint32_t origin)
{
	zexpect_equal(pairs[index].slot, slot);
	zexpect_equal(pairs[index].gyro_lsb[0], (int16_t)(2U * origin));
	zexpect_equal(pairs[index].accel_lsb[0], (int16_t)(2U * origin + 1U));
}

static void before(void *fixture)
{
	ARG_UNUSED(fixture);
	fill_words();
	lsm6dsox_decoder_init(&decoder, 0);
}

ZTEST_SUITE(lsm6dsox_decoder, NULL, NULL, before, NULL, NULL);

ZTEST(lsm6dsox_decoder, test_bytes_worked_out_by_hand)
{
	static const uint8_t bytes[] = {
		0x09, 0x01, 0x00, 0xFF, 0x7F, 0x00, 0x80, /* 1, 32767, -32768 */
		0x11, 0xFE, 0xFF, 0x00, 0x02, 0x34, 0x12, /* -2, 512, 0x1234 */
	};
	static const int16_t gyro[3] = {1, 32767, -32768};
	static const int16_t accel[3] = {-2, 512, 0x1234};

	zexpect_equal(lsm6dsox_decoder_push(&decoder, bytes, sizeof(bytes), 0, pairs).pairs, 1);
	zexpect_mem_equal(pairs[0].gyro_lsb, gyro, sizeof(gyro));
	zexpect_mem_equal(pairs[0].accel_lsb, accel, sizeof(accel));
}

ZTEST(lsm6dsox_decoder, test_every_pair_once_whatever_the_bursts)
{
	uint32_t slot = 0;

	for (uint32_t i = 0; i < WORDS; i += 3U) {
		const struct lsm6dsox_burst burst = push(i, 3U);

		for (size_t p = 0; p < burst.pairs; p++, slot++) {
			expect_pair(p, slot, slot);
		}
	}
	zexpect_equal(slot, SLOTS);
	zexpect_equal(decoder.counters.slots_lost, 0);
}

ZTEST(lsm6dsox_decoder, test_damaged_tag_costs_its_slot)
{
	words[9 * LSM6DSOX_WORD_SIZE] ^= 0x04;
	zexpect_equal(push(0, WORDS).pairs, SLOTS - 1U);
	expect_pair(3, 3, 3);
	expect_pair(4, 5, 5);
	zexpect_equal(decoder.counters.parity_errors, 1);
	zexpect_equal(decoder.counters.slots_lost, 1);
}

ZTEST(lsm6dsox_decoder, test_damage_that_parity_cannot_see)
{
	/* Gyroscope of slot 5 as accelerometer of slot 6: two bits of the sensor, none of parity. */
	words[10 * LSM6DSOX_WORD_SIZE] = accel_tag[2];
	zexpect_equal(push(0, WORDS).pairs, SLOTS - 1U);
	expect_pair(5, 6, 6);
	zexpect_equal(decoder.counters.words_out_of_sequence, 1);
	zexpect_equal(decoder.counters.tag_gaps, 0);
}

ZTEST(lsm6dsox_decoder, test_lost_words_are_counted)
{
	zexpect_equal(push(0, 9).pairs, 4);
	zexpect_equal(push(12, WORDS - 12).pairs, SLOTS - 6U);
	expect_pair(0, 6, 6);
	zexpect_equal(decoder.counters.tag_gaps, 1);
	zexpect_equal(decoder.counters.slots_lost, 2);
}

ZTEST(lsm6dsox_decoder, test_no_pair_across_a_break)
{
	uint32_t newest;

	/* Gyroscope of slot 3, then accelerometer of slot 7, whose counter is the same. */
	zexpect_equal(push(0, 7).pairs, 3);
	lsm6dsox_decoder_break(&decoder);
	zexpect_equal(push(15, 9).pairs, 4);
	expect_pair(0, 4, 8);
	zexpect_true(lsm6dsox_decoder_newest(&decoder, &newest));
	zexpect_equal(newest, 7);
	lsm6dsox_decoder_skip(&decoder, 4);
	zexpect_equal(push(24, 4).pairs, 2);
	expect_pair(0, 12, 12);
}

ZTEST(lsm6dsox_decoder, test_short_reads)
{
	memset(&words[8 * LSM6DSOX_WORD_SIZE], 0, 2 * LSM6DSOX_WORD_SIZE);
	zexpect_equal(push(0, 10).words, 8);
	zexpect_equal(decoder.counters.short_reads, 1);
	zexpect_equal(decoder.counters.words_empty, 2);
}

ZTEST(lsm6dsox_decoder, test_mark)
{
	const struct lsm6dsox_burst burst =
		lsm6dsox_decoder_push(&decoder, words, sizeof(words), 32, pairs);

	zexpect_true(burst.mark_found);
	zexpect_equal(burst.mark_slot, 15);
}
