// A function in C++ as an example: keeps its speed, and a time gap behind who drives ahead in its lane.
//
//     c++ -std=c++17 -O2 -I "$(resim function include)" follow.cpp -o follow
#include <algorithm>
#include <cmath>

#include "resim_function.hpp"

class Follow : public resim::Function {
 public:
  void reset(const resim::Setup& setup) override {
    wanted_ = setup.start.v;
    gap_ = setup.parameters.at("time_gap").number();
  }

  resim::Command step(const resim::Perceived& seen) override {
    double a = 0.4 * (wanted_ - seen.ego.v);
    for (const auto& object : seen.objects) {
      if (object.x < 0.0 || std::abs(object.y) > 1.5) continue;
      const double spare = object.x - 0.5 * object.length - 2.5 - 4.0 - gap_ * seen.ego.v;
      a = std::min(a, 0.25 * spare + 0.8 * (object.v - seen.ego.v));
    }
    return {std::clamp(a, -8.0, 2.0), 0.0, {}};
  }

 private:
  double wanted_ = 0.0, gap_ = 1.5;
};

int main() {
  Follow follow;
  return resim::serve(follow);
}
