/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_decoder.h"

#include <string.h>

#define WORDS_PER_SLOT 2U
#define PLACE_MODULUS  (WORDS_PER_SLOT * LSM6DSOX_SLOT_MODULUS)
#define SLOT_SIZE      (WORDS_PER_SLOT * LSM6DSOX_WORD_SIZE)

/* Output of one push. */
struct output {
	struct lsm6dsox_pair *pairs;
	size_t count;
};

static bool has_even_parity(uint8_t tag)
{
	tag ^= (uint8_t)(tag >> 4);
	tag ^= (uint8_t)(tag >> 2);
	tag ^= (uint8_t)(tag >> 1);
	return (tag & 1U) == 0U;
}

/* The three samples of a word. */
static void read_axes(const uint8_t *bytes, int16_t *axes_lsb)
{
	/* At -O2 GCC would leave the loop standing. */
#pragma GCC unroll 3
	for (size_t i = 0; i < 3; i++) {
		axes_lsb[i] = (int16_t)(uint16_t)(bytes[1 + 2 * i] |
						  ((uint16_t)bytes[2 + 2 * i] << 8));
	}
}

static struct lsm6dsox_word parse(const uint8_t *bytes)
{
	struct lsm6dsox_word word = {
		.sensor = (uint8_t)(bytes[0] >> 3),
		.count = (bytes[0] >> 1) & (LSM6DSOX_SLOT_MODULUS - 1U),
		.distance = 1U,
	};

	read_axes(bytes, word.axes_lsb);
	return word;
}

/* Number that the tag gives a word, modulo PLACE_MODULUS. */
static uint32_t number_of(const struct lsm6dsox_decoder *d, const struct lsm6dsox_word *word)
{
	return WORDS_PER_SLOT * word->count + (word->sensor == d->first_sensor ? 0U : 1U);
}

/* Place that the tag gives a word, modulo PLACE_MODULUS. */
static uint32_t residue(const struct lsm6dsox_decoder *d, const struct lsm6dsox_word *word)
{
	return (number_of(d, word) + d->phase) & (PLACE_MODULUS - 1U);
}

/* Words from place @p from to the next one with that number: 0 .. PLACE_MODULUS - 1. */
static uint32_t words_ahead(uint32_t from, uint32_t number)
{
	return (number - from) & (PLACE_MODULUS - 1U);
}

static void drop_half(struct lsm6dsox_decoder *d)
{
	if (d->half.sensor != 0U) {
		d->half.sensor = 0U;
		d->counters.words_unpaired++;
	}
}

static void drop_waiting(struct lsm6dsox_decoder *d)
{
	if (d->waiting.sensor != 0U) {
		d->waiting.sensor = 0U;
		d->counters.words_out_of_sequence++;
	}
}

/* @p count pairs are given out, the first of @p slot. */
static void count_pairs(struct lsm6dsox_decoder *d, uint32_t slot, uint32_t count)
{
	d->counters.words_paired += WORDS_PER_SLOT * count;
	d->counters.pairs += count;
	d->counters.slots_lost += slot - d->next_slot;
	d->next_slot = slot + count;
}

static void give_pair(struct lsm6dsox_decoder *d, uint32_t slot,
		      const struct lsm6dsox_word *second, struct output *out)
{
	struct lsm6dsox_pair *pair = &out->pairs[out->count++];
	const bool gyro_first = d->half.sensor == LSM6DSOX_TAG_GYRO;
	const struct lsm6dsox_word *gyro = gyro_first ? &d->half : second;
	const struct lsm6dsox_word *accel = gyro_first ? second : &d->half;

	pair->slot = slot;
	memcpy(pair->gyro_lsb, gyro->axes_lsb, sizeof(pair->gyro_lsb));
	memcpy(pair->accel_lsb, accel->axes_lsb, sizeof(pair->accel_lsb));
	d->half.sensor = 0U;
	count_pairs(d, slot, 1U);
}

/* A word whose place is certain: it is d->place. */
static void accept(struct lsm6dsox_decoder *d, const struct lsm6dsox_word *word, struct output *out)
{
	const uint32_t place = d->place++;

	d->damaged = 0U;
	if (place % WORDS_PER_SLOT == 0U) {
		drop_half(d);
		d->half = *word;
	} else if (d->half.sensor != 0U && d->half.distance == 1U) {
		give_pair(d, place / WORDS_PER_SLOT, word, out);
	} else {
		drop_half(d);
		d->counters.words_unpaired++;
	}
}

/* Something stood here that cannot be used. */
static void keep_place(struct lsm6dsox_decoder *d)
{
	d->waiting.distance++;
	d->half.distance++;
	d->damaged++;
	if (d->locked) {
		d->place++;
	}
}

static void let_wait(struct lsm6dsox_decoder *d, const struct lsm6dsox_word *word)
{
	drop_waiting(d);
	d->damaged_before_waiting = d->damaged;
	/* For now it holds its place as a damaged one would. */
	keep_place(d);
	d->waiting = *word;
}

/* The order within a slot follows from two neighbours of different kind. */
static void learn_order(struct lsm6dsox_decoder *d, const struct lsm6dsox_word *next)
{
	const struct lsm6dsox_word *before = &d->waiting;

	if (before->sensor == 0U || before->distance != 1U || before->sensor == next->sensor) {
		return;
	}
	if (next->count == before->count) {
		d->first_sensor = before->sensor;
	} else if (next->count == ((before->count + 1U) & (LSM6DSOX_SLOT_MODULUS - 1U))) {
		d->first_sensor = next->sensor;
	}
}

/* Whether @p next carries on from the word that waits. */
static bool confirms_waiting(const struct lsm6dsox_decoder *d, const struct lsm6dsox_word *next)
{
	return d->waiting.sensor != 0U && d->first_sensor != 0U &&
	       words_ahead(residue(d, &d->waiting) + d->waiting.distance, residue(d, next)) == 0U;
}

/* Where the word that waits stands, now that its neighbour speaks for it. */
static void settle_place(struct lsm6dsox_decoder *d)
{
	uint32_t counted;
	uint32_t ahead;

	if (!d->continues) {
		const uint32_t number = number_of(d, &d->waiting);

		d->place = WORDS_PER_SLOT * d->next_slot + number % WORDS_PER_SLOT;
		d->phase = (uint8_t)words_ahead(number, d->place);
		return;
	}
	if (!d->locked) {
		d->place += words_ahead(d->place, residue(d, &d->waiting));
		return;
	}
	counted = d->place - d->waiting.distance;
	ahead = words_ahead(counted, residue(d, &d->waiting));
	if (PLACE_MODULUS - ahead <= d->damaged_before_waiting && PLACE_MODULUS - ahead < ahead) {
		/* A damaged word of another kind had no place: fewer went by than counted. */
		d->place = counted - (PLACE_MODULUS - ahead);
		return;
	}
	d->counters.tag_gaps++;
	d->place = counted + ahead;
}

/* Go on from the word that waited, which its neighbour @p next has confirmed. */
static void accept_both(struct lsm6dsox_decoder *d, const struct lsm6dsox_word *next,
			struct output *out)
{
	const struct lsm6dsox_word waiting = d->waiting;

	settle_place(d);
	d->waiting.sensor = 0U;
	d->locked = true;
	d->continues = true;
	accept(d, &waiting, out);
	d->place += waiting.distance - 1U;
	accept(d, next, out);
}

/* @return 0, or how many places ago a new numbering began. */
static uint32_t push_sensor(struct lsm6dsox_decoder *d, const struct lsm6dsox_word *word,
			    struct output *out)
{
	if (d->first_sensor == 0U) {
		learn_order(d, word);
	}
	if (d->locked && words_ahead(d->place, residue(d, word)) == 0U) {
		drop_waiting(d);
		accept(d, word, out);
		return 0U;
	}
	if (confirms_waiting(d, word)) {
		const uint32_t distance = d->waiting.distance;

		accept_both(d, word, out);
		return distance;
	}
	let_wait(d, word);
	return 0U;
}

/* Tags of the two sensors by slot counter, with their parity. */
static const uint8_t tags[][LSM6DSOX_SLOT_MODULUS] = {
	[LSM6DSOX_TAG_GYRO] = {0x09, 0x0a, 0x0c, 0x0f},
	[LSM6DSOX_TAG_ACCEL] = {0x11, 0x12, 0x14, 0x17},
};

/*
 * The short way: whole slots one behind the other, nothing waiting. What push_sensor() would come to
 * for each of their words, at a fifth of its cost. @return bytes that are done with.
 */
static size_t push_slots(struct lsm6dsox_decoder *d, const uint8_t *words, size_t size,
			 struct output *out)
{
	const bool gyro_first = d->first_sensor == LSM6DSOX_TAG_GYRO;
	const uint8_t *first_tags = tags[gyro_first ? LSM6DSOX_TAG_GYRO : LSM6DSOX_TAG_ACCEL];
	const uint8_t *second_tags = tags[gyro_first ? LSM6DSOX_TAG_ACCEL : LSM6DSOX_TAG_GYRO];
	const uint32_t first_slot = d->place / WORDS_PER_SLOT;
	uint32_t slot = first_slot;
	size_t at = 0;

	if (!d->locked || d->waiting.sensor != 0U || d->half.sensor != 0U ||
	    d->place % WORDS_PER_SLOT != 0U) {
		return 0;
	}
	for (; at + SLOT_SIZE <= size; at += SLOT_SIZE) {
		const uint8_t *first = &words[at];
		const uint8_t *second = first + LSM6DSOX_WORD_SIZE;
		const uint32_t count = (slot - d->phase / WORDS_PER_SLOT) % LSM6DSOX_SLOT_MODULUS;

		if (first[0] != first_tags[count] || second[0] != second_tags[count]) {
			break;
		}
		struct lsm6dsox_pair *pair = &out->pairs[out->count++];

		pair->slot = slot++;
		read_axes(gyro_first ? first : second, pair->gyro_lsb);
		read_axes(gyro_first ? second : first, pair->accel_lsb);
	}
	if (at > 0) {
		count_pairs(d, first_slot, slot - first_slot);
		d->place = WORDS_PER_SLOT * slot;
		d->damaged = 0U;
	}
	return at;
}

void lsm6dsox_decoder_init(struct lsm6dsox_decoder *d, uint32_t first_slot)
{
	memset(d, 0, sizeof(*d));
	d->next_slot = first_slot;
}

void lsm6dsox_decoder_break(struct lsm6dsox_decoder *d)
{
	drop_half(d);
	drop_waiting(d);
	d->locked = false;
	d->damaged = 0U;
}

void lsm6dsox_decoder_restart(struct lsm6dsox_decoder *d, uint32_t next_slot)
{
	lsm6dsox_decoder_break(d);
	d->continues = false;
	if (next_slot > d->next_slot) {
		d->counters.slots_lost += next_slot - d->next_slot;
		d->next_slot = next_slot;
	}
}

void lsm6dsox_decoder_skip(struct lsm6dsox_decoder *d, uint32_t slots)
{
	d->place += WORDS_PER_SLOT * slots;
	d->next_slot += slots;
	d->counters.slots_lost += slots;
}

bool lsm6dsox_decoder_newest(const struct lsm6dsox_decoder *d, uint32_t *slot)
{
	*slot = (d->place - 1U) / WORDS_PER_SLOT;
	return d->locked && d->waiting.sensor == 0U;
}

struct lsm6dsox_burst lsm6dsox_decoder_push(struct lsm6dsox_decoder *d, const uint8_t *words,
					    size_t size, size_t mark, struct lsm6dsox_pair *pairs)
{
	struct output out = {.pairs = pairs};
	size_t in_fifo = 0;
	size_t places_since_mark = 0; /* The marked word is the first of them */
	bool is_short = size % LSM6DSOX_WORD_SIZE != 0U;

	for (size_t at = 0; at + LSM6DSOX_WORD_SIZE <= size; at += LSM6DSOX_WORD_SIZE) {
		bool has_place = true;
		const size_t done = push_slots(d, &words[at], size - at, &out);
		const size_t places = done / LSM6DSOX_WORD_SIZE;

		if (places_since_mark > 0U) {
			places_since_mark += places;
		} else if (mark > in_fifo && mark <= in_fifo + places) {
			places_since_mark = in_fifo + places + 1U - mark;
		}
		in_fifo += places;
		at += done;
		if (at + LSM6DSOX_WORD_SIZE > size) {
			break;
		}
		const struct lsm6dsox_word word = parse(&words[at]);

		if (words[at] == LSM6DSOX_TAG_EMPTY) {
			d->counters.words_empty++;
			is_short = true;
			continue;
		}
		in_fifo++;
		if (!has_even_parity(words[at])) {
			d->counters.parity_errors++;
			keep_place(d);
		} else if (word.sensor == LSM6DSOX_TAG_GYRO || word.sensor == LSM6DSOX_TAG_ACCEL) {
			const uint32_t renumbered = push_sensor(d, &word, &out);

			if (renumbered != 0U && places_since_mark > renumbered) {
				/* The mark stands in the old numbering. */
				places_since_mark = 0;
			}
		} else if (word.sensor == LSM6DSOX_TAG_CONFIG_CHANGE) {
			d->counters.config_changes++;
			has_place = false;
		} else if (word.sensor == LSM6DSOX_TAG_TEMPERATURE ||
			   word.sensor == LSM6DSOX_TAG_TIMESTAMP) {
			d->counters.words_other++;
			has_place = false;
		} else {
			d->counters.unknown_tags++;
			keep_place(d);
		}
		if (has_place && (places_since_mark > 0U || in_fifo == mark)) {
			places_since_mark++;
		}
	}
	d->counters.short_reads += is_short ? 1U : 0U;
	return (struct lsm6dsox_burst){
		.pairs = out.count,
		.words = in_fifo,
		.mark_slot = (d->place - (uint32_t)places_since_mark) / WORDS_PER_SLOT,
		.mark_found = places_since_mark > 0U && d->locked && d->waiting.sensor == 0U,
	};
}
