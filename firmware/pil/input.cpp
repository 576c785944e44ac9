// SPDX-License-Identifier: Apache-2.0
#include "input.hpp"

#include <cstring>

#include "semihost.hpp"

namespace pil
{
namespace
{

constexpr char NAME[] = "input.bin";
constexpr const char *CUT = "the input file ends early";

// Counts the words of all parameters and draws a hash (FNV-1a) from their names and sizes.
struct Signature {
	std::uint32_t words = 0;
	std::uint32_t hash = 2166136261u;

	void mix(std::uint32_t byte)
	{
		hash = (hash ^ byte) * 16777619u;
	}

	void add(const char *name, std::uint32_t count)
	{
		for (; *name != '\0'; name++) {
			mix(static_cast<unsigned char>(*name));
		}
		mix(count);
		words += count;
	}

	template <class T> void operator()(const char *name, const T &)
	{
		add(name, 1);
	}

	template <int Rows, int Columns>
	void operator()(const char *name, const Eigen::Matrix<float, Rows, Columns> &)
	{
		add(name, Rows * Columns);
	}
};

// Takes the parameters' values from words: integers as they are, the rest as bits of a float.
struct FromWords {
	const std::uint32_t *word;

	void operator()(const char *, bool &member)
	{
		member = *word++ != 0;
	}

	void operator()(const char *, std::int32_t &member)
	{
		member = static_cast<std::int32_t>(*word++);
	}

	void operator()(const char *, float &member)
	{
		std::memcpy(&member, word++, sizeof(member));
	}

	template <int Rows, int Columns>
	void operator()(const char *name, Eigen::Matrix<float, Rows, Columns> &member)
	{
		for (int i = 0; i < Rows * Columns; i++) {
			(*this)(name, member(i / Columns, i % Columns));
		}
	}
};

} // namespace

const char *Input::open(bv::Params<float> &params)
{
	file_ = semihost::open(NAME, sizeof(NAME) - 1, semihost::Mode::READ_BINARY);
	if (file_ < 0) {
		return "there is no file input.bin";
	}
	if (!semihost::read(file_, &header_, sizeof(header_))) {
		return CUT;
	}
	if (header_.magic != INPUT_MAGIC) {
		return "the input file is none of this program's: wrong magic number";
	}
	if (header_.version != VERSION) {
		return "the input file is of another version";
	}
	followers_left_ = header_.followers;
	return read_params(params);
}

const char *Input::read_params(bv::Params<float> &params)
{
	static std::uint32_t words[MAX_PARAMETER_WORDS];
	Signature own;

	bv::for_each_param(params, own);
	if (own.words > MAX_PARAMETER_WORDS || header_.parameter_words != own.words ||
	    header_.parameter_names != own.hash) {
		return "the input file has other parameters than the estimator";
	}
	if (!semihost::read(file_, words, own.words * sizeof(words[0]))) {
		return CUT;
	}
	bv::for_each_param(params, FromWords{words});
	return bv::params_fault(params);
}

const char *Input::read_sample(bv::Sample<float> &sample)
{
	SampleRecord record;

	if (!semihost::read(file_, &record, sizeof(record))) {
		return CUT;
	}
	if (record.clipped > 1) {
		return "the input file has a clip flag that is neither 0 nor 1";
	}
	sample.t_ticks = record.t_ticks;
	for (int i = 0; i < 3; i++) {
		sample.accel_mps2[i] = record.accel_mps2[i];
		sample.gyro_radps[i] = record.gyro_radps[i];
	}
	sample.clipped = record.clipped != 0;
	sample.t_sigma_s = record.t_sigma_s;
	return nullptr;
}

const char *Input::next(StepInput &step)
{
	StepRecord record;

	if (!semihost::read(file_, &record, sizeof(record))) {
		return CUT;
	}
	if (record.followers > bv::MAX_FOLLOWER_SAMPLES) {
		return "the input file has too many follower samples on one step";
	}
	if (record.followers > followers_left_) {
		return "the input file has more follower samples than its header says";
	}
	followers_left_ -= record.followers;
	step.followers = static_cast<int>(record.followers);

	const char *fault = read_sample(step.leader);

	for (int i = 0; i < step.followers && fault == nullptr; i++) {
		fault = read_sample(step.follower[i]);
	}
	return fault;
}

const char *Input::end()
{
	unsigned char more;

	if (followers_left_ != 0) {
		return "the input file has fewer follower samples than its header says";
	}
	if (semihost::read(file_, &more, 1)) {
		return "the input file goes on after its last step";
	}
	semihost::close(file_);
	return nullptr;
}

} // namespace pil
