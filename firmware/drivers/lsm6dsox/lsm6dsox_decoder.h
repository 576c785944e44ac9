/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * FIFO words of the LSM6DSOX -> pairs of one gyroscope and one accelerometer sample.
 *
 * Pure C11: no kernel, no clock, no bus. Words go in as they come off the bus, pairs come out, and
 * every word that is not part of a pair is counted under the name of what was wrong with it.
 *
 * A FIFO word is a tag byte and six data bytes (LSM6DSOX datasheet, FIFO_DATA_OUT_TAG 78h):
 *
 *     bits 7..3 sensor    bits 2..1 slot counter    bit 0 makes the number of ones even
 *
 * Each sample instant is a slot. With both sensors batched at one rate a slot puts a gyroscope
 * word and an accelerometer word into the FIFO, always in the same order, both with the slot's
 * counter, which counts modulo four. Sensor and counter together therefore number the words modulo
 * eight, and the decoder treats them so: word n + 1 must carry the number after that of word n.
 *
 * - A word with wrong parity keeps its place, so a run of them, however long, moves nothing.
 * - A word whose number does not fit waits for the next one. If that carries on from it, words were
 *   lost in between: the decoder moves on by the smallest number of words that explains it. If the
 *   next one carries on from before, the tag was damaged in a way that parity cannot see.
 * - Two words make a pair when they are neighbours, and only then. So the halves of a pair come
 *   from one slot, no slot comes out twice, and slot numbers rise.
 *
 * What the numbers cannot tell is a loss of eight words, or sixteen, and so on. Where words may
 * have gone unseen (an overrun, a failed transfer) the caller says so with lsm6dsox_decoder_break(),
 * which forbids a pair across the gap, and then corrects the slot numbers from the hardware time of
 * the samples with lsm6dsox_decoder_skip().
 *
 * Words of other kinds (configuration change, timestamp, temperature) take no place in this
 * numbering; their counter is not looked at, because on a related part it stays zero.
 */
#ifndef BV_LSM6DSOX_DECODER_H_
#define BV_LSM6DSOX_DECODER_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LSM6DSOX_WORD_SIZE 7U

/** Slot counter modulus: what a break can leave undecided. */
#define LSM6DSOX_SLOT_MODULUS 4U

/** Sensor codes of a tag that this driver meets (datasheet, table of TAG_SENSOR). */
enum lsm6dsox_tag {
	/** Read beyond the last word. */
	LSM6DSOX_TAG_EMPTY = 0x00,
	LSM6DSOX_TAG_GYRO = 0x01,
	LSM6DSOX_TAG_ACCEL = 0x02,
	LSM6DSOX_TAG_TEMPERATURE = 0x03,
	LSM6DSOX_TAG_TIMESTAMP = 0x04,
	LSM6DSOX_TAG_CONFIG_CHANGE = 0x05,
};

/** One sample instant: raw counts, x y z, sensor frame. */
struct lsm6dsox_pair {
	/** Slot number; see lsm6dsox_decoder_init(). */
	uint32_t slot;
	int16_t gyro_lsb[3];
	int16_t accel_lsb[3];
};

/** Counts since lsm6dsox_decoder_init(). A word adds to exactly one of the first eight, at once or
 * when its neighbour has come.
 */
struct lsm6dsox_decoder_counters {
	/** Words that became part of a pair. */
	uint32_t words_paired;
	/** Good sensor words dropped because their partner is missing. */
	uint32_t words_unpaired;
	/** Good parity, but the tag does not fit between its neighbours. */
	uint32_t words_out_of_sequence;
	/** Words whose tag has an odd number of ones. */
	uint32_t parity_errors;
	/** Words with good parity and a sensor code that is not defined or not asked for. */
	uint32_t unknown_tags;
	/** Configuration-change words. */
	uint32_t config_changes;
	/** Timestamp and temperature words, skipped. */
	uint32_t words_other;
	/** Words read beyond the end of the FIFO. */
	uint32_t words_empty;
	/** Bursts that held fewer words than were asked for, or a part of a word. */
	uint32_t short_reads;
	/** Breaks in the numbering, unannounced, that the words after it confirm. */
	uint32_t tag_gaps;
	/** Slots that were passed over without a pair. */
	uint32_t slots_lost;
	/** Pairs given out. */
	uint32_t pairs;
};

/** A good sensor word that waits for its neighbour. */
struct lsm6dsox_word {
	int16_t axes_lsb[3];
	/** Sensor code; 0 for no word. */
	uint8_t sensor;
	/** Slot counter, 0..3. */
	uint8_t count;
	/** Places from this word to the one that comes next. */
	uint32_t distance;
};

/** State; the members are public so that a test can set and read them. */
struct lsm6dsox_decoder {
	struct lsm6dsox_decoder_counters counters;
	/** Place of the next word, two per slot; after a break, the lowest it can have. */
	uint32_t place;
	/** First slot that was neither given out nor counted as lost. */
	uint32_t next_slot;
	/** Damaged words since the last one whose place was certain. */
	uint32_t damaged;
	/** What @ref damaged was when the waiting word came. */
	uint32_t damaged_before_waiting;
	/** Sensor code of a slot's first word; 0 until it has been seen. */
	uint8_t first_sensor;
	/** Place minus number of a word, modulo eight: the counter starts anywhere. */
	uint8_t phase;
	/** Whether the next word is known to be the one at @ref place. */
	bool locked;
	/** Whether the slot counter ties what comes next to what came before. */
	bool continues;
	/** A word whose place is not certain. */
	struct lsm6dsox_word waiting;
	/** First half of a pair. */
	struct lsm6dsox_word half;
};

/** What one burst held, beside the pairs. */
struct lsm6dsox_burst {
	/** Pairs written. */
	size_t pairs;
	/** Words that were in the FIFO: all but the empty ones. */
	size_t words;
	/** Slot of the marked word, when @ref mark_found. */
	uint32_t mark_slot;
	/** The marked word's place is known. */
	bool mark_found;
};

/** Start anew; the first slot seen gets the number @p first_slot. */
void lsm6dsox_decoder_init(struct lsm6dsox_decoder *decoder, uint32_t first_slot);

/**
 * Words may have been lost between what was pushed and what comes next.
 *
 * Words that wait for a neighbour are dropped. The numbers go on at the next slot that the counter
 * allows; lsm6dsox_decoder_skip() adds what the counter cannot tell.
 */
void lsm6dsox_decoder_break(struct lsm6dsox_decoder *decoder);

/**
 * The FIFO was emptied and its counter may restart: the next slot seen gets @p next_slot.
 *
 * Counters go on. A @p next_slot that was passed already is raised to the first free one.
 */
void lsm6dsox_decoder_restart(struct lsm6dsox_decoder *decoder, uint32_t next_slot);

/** @p slots more were lost than was counted: add them to the numbers of all that follows. */
void lsm6dsox_decoder_skip(struct lsm6dsox_decoder *decoder, uint32_t slots);

/** Slot of the newest word. @return false when it is not known. */
bool lsm6dsox_decoder_newest(const struct lsm6dsox_decoder *decoder, uint32_t *slot);

/**
 * Decode one burst.
 *
 * @param words what came off the bus.
 * @param size bytes in @p words; a part of a word at the end counts as a short read.
 * @param mark number of the word, from 1, whose slot the caller wants; 0 for none. Only words that
 *        were in the FIFO count.
 * @param[out] pairs room for size / (2 * LSM6DSOX_WORD_SIZE) + 2 pairs is always enough.
 * @return what was found.
 */
struct lsm6dsox_burst lsm6dsox_decoder_push(struct lsm6dsox_decoder *decoder, const uint8_t *words,
					    size_t size, size_t mark, struct lsm6dsox_pair *pairs);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_DECODER_H_ */
