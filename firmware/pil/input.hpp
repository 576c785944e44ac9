// SPDX-License-Identifier: Apache-2.0
/// The input file: checked before anything of it is used. Format: pil_format.hpp.
#ifndef BV_PIL_INPUT_HPP_
#define BV_PIL_INPUT_HPP_

#include <cstdint>

#include "estimator.hpp"
#include "pil_format.hpp"

namespace pil
{

/// One step's samples.
struct StepInput {
	bv::Sample<float> leader;
	bv::Sample<float> follower[bv::MAX_FOLLOWER_SAMPLES];
	int followers = 0;
};

class Input
{
public:
	/// Open and read as far as the first step; nullptr, or what is wrong.
	const char *open(bv::Params<float> &params);

	/// The next of steps() steps; nullptr, or what is wrong.
	const char *next(StepInput &step);

	/// What is wrong after the last step; nullptr when the file ends there.
	const char *end();

	std::uint32_t steps() const
	{
		return header_.steps;
	}

private:
	const char *read_params(bv::Params<float> &params);
	const char *read_sample(bv::Sample<float> &sample);

	std::int32_t file_ = -1;
	Header header_{};
	std::uint32_t followers_left_ = 0;
};

} // namespace pil

#endif // BV_PIL_INPUT_HPP_
