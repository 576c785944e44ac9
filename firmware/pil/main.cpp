// SPDX-License-Identifier: Apache-2.0
// The estimator in float on an emulated Cortex-M4F: input.bin in, output.bin out, both in the
// working folder of the host.
#include <new>

#include "clock.hpp"
#include "input.hpp"
#include "pil_format.hpp"
#include "semihost.hpp"
#include "stack.hpp"

namespace
{

using bv::Status;
using Core = bv::Estimator<float>;

constexpr char NAME[] = "output.bin";
constexpr std::uint32_t STEPS_BETWEEN_NEWS = 256;

alignas(Core) unsigned char place[sizeof(Core)];

[[noreturn]] void refuse(const char *fault)
{
	semihost::print("pil: ");
	semihost::print(fault);
	semihost::print("\n");
	semihost::exit(2);
}

void news(std::uint32_t step)
{
	char text[] = "pil: step           \n";
	char *digit = text + sizeof(text) - 3;

	do {
		*digit-- = static_cast<char>('0' + step % 10);
		step /= 10;
	} while (step > 0);
	semihost::print(text);
}

template <int N> void copy(const Eigen::Matrix<float, N, 1> &from, float (&to)[N])
{
	for (int i = 0; i < N; i++) {
		to[i] = from[i];
	}
}

void fill(const bv::Output<float> &output, pil::OutputRecord &record)
{
	record.t_ticks = output.t_ticks;
	copy(output.p, record.p);
	copy(output.v, record.v);
	copy(output.q, record.q);
	copy(output.b_a, record.b_a);
	copy(output.b_g, record.b_g);
	copy(output.variance, record.variance);
	copy(output.centre_velocity_mps, record.centre_velocity_mps);
	record.centre_height_m = output.centre_height_m;
	copy(output.innovation, record.innovation);
	record.nis = output.nis;
	record.gate = output.gate;
	copy(output.q_madgwick, record.q_madgwick);
	record.divergence_rad = output.divergence_rad;
	record.flags = output.flags;
}

void write(std::int32_t file, const void *from, std::uint32_t bytes)
{
	if (!semihost::write(file, from, bytes)) {
		refuse("the output file cannot be written");
	}
}

std::uint32_t run(Core &core, pil::Input &input, std::int32_t file)
{
	pil::StepInput step;
	bv::Output<float> output;
	const std::uintptr_t top = pil_stack::pointer();

	pil_stack::paint(top);
	for (std::uint32_t k = 0; k < input.steps(); k++) {
		if (const char *fault = input.next(step)) {
			refuse(fault);
		}
		const std::uint32_t begin = pil_clock::now();
		const Status status = core.step(step.leader, step.follower, step.followers, output);
		const std::uint32_t end = pil_clock::now();
		pil::OutputRecord record{};

		if (status == Status::ESTIMATED) {
			fill(output, record);
		}
		record.status = static_cast<std::uint32_t>(status);
		record.clock_ticks = pil_clock::between(begin, end);
		write(file, &record, sizeof(record));
		if (k % STEPS_BETWEEN_NEWS == 0) {
			news(k);
		}
	}
	return pil_stack::used(top);
}

} // namespace

int main()
{
	bv::Params<float> params;
	pil::Input input;

	if (const char *fault = input.open(params)) {
		refuse(fault);
	}
	const std::int32_t file =
		semihost::open(NAME, sizeof(NAME) - 1, semihost::Mode::WRITE_BINARY);

	if (file < 0) {
		refuse("the output file cannot be opened");
	}
	Core *const core = new (place) Core(params);
	pil::Summary summary{};

	pil_clock::start();
	summary.known_ticks[0] = pil_clock::known<1>();
	summary.known_ticks[1] = pil_clock::known<2>();
	summary.known_ticks[2] = pil_clock::known<3>();
	summary.known_ticks[3] = pil_clock::known<100>();
	summary.known_ticks[4] = pil_clock::known<1000>();
	summary.step_stack_bytes = run(*core, input, file);
	if (const char *fault = input.end()) {
		refuse(fault);
	}
	summary.magic = pil::OUTPUT_MAGIC;
	summary.steps = input.steps();
	summary.estimator_bytes = sizeof(Core);
	write(file, &summary, sizeof(summary));
	semihost::close(file);
	return 0;
}
