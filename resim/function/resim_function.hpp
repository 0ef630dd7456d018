// An AD function in C++ as a process build of resim: derive from resim::Function and call resim::serve in main.
// One header, C++17, nothing else. docs/formats/process.md says what the messages are; what it prints is kept with the run.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <exception>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

namespace resim {

constexpr int PROTOCOL = 1;

// A value of a message: nothing, a number, a text (or bytes), a list or a map.
struct Value {
  enum class Kind { nil, boolean, integer, real, text, list, map } kind = Kind::nil;
  std::int64_t integer = 0;
  double real = 0.0;
  std::string text;
  std::vector<Value> list;
  std::map<std::string, Value> map;

  double number() const {
    if (kind == Kind::real) return real;
    if (kind == Kind::integer || kind == Kind::boolean) return static_cast<double>(integer);
    throw std::runtime_error("expected a number");
  }
  const Value& at(const std::string& name) const {
    const auto found = map.find(name);
    if (found == map.end()) throw std::runtime_error("there is no field " + name + " (of parameters: those of the build file)");
    return found->second;
  }
};

// The EGO: x, y [m] of its box centre and heading [rad] in the map, v [m/s], a [m/s2], yaw_rate [rad/s].
struct EgoState { double x = 0, y = 0, heading = 0, v = 0, a = 0, yaw_rate = 0; };

// An object in the EGO's frame: x, y [m] ahead and left of the EGO's box centre to its own, heading [rad] against the
// EGO's, v [m/s] over ground along its heading, length, width [m], z [m] of the road under it above that under the EGO,
// NaN where it is not known.
struct Object { std::string id, kind; double x = 0, y = 0, heading = 0, v = 0, length = 0, width = 0, z = 0; };

struct Perceived { double t = 0; EgoState ego; std::vector<Object> objects; };

using Point = std::array<double, 2>;

// A lane of one lane section: centre, left and right border [m] in the direction of its road's s; along: whether it is
// driven in that direction, too, and not against it; after: numbers of the lanes that it goes on into, in driving
// direction.
struct Lane {
  std::string road, type;
  int section = 0, lane = 0;
  std::vector<Point> centre, left, right;
  bool along = true;
  std::vector<int> after;
};

// What a function gets before a run. map: the OpenDRIVE file; goal [m]: where the recorded EGO was last; cycle [s]
// between two answers; route: for each step of it the ids of the roads, of which the EGO is on one.
struct Setup {
  std::string map;
  std::vector<Lane> lanes;
  Value parameters;
  EgoState start;
  Point goal{};
  double length = 0, width = 0, cycle = 0;
  std::int64_t seed = 0;
  std::vector<std::vector<std::string>> route;
};

// The answer: acceleration [m/s2], curvature [1/m, left positive], and a plan, if there is one: t [s], x, y [m], v [m/s].
struct Command { double acceleration = 0, curvature = 0; std::vector<std::array<double, 4>> plan; };

class Function {
 public:
  virtual ~Function() = default;
  virtual void reset(const Setup& setup) = 0;
  virtual Command step(const Perceived& perceived) = 0;
  virtual void close() {}
};

namespace detail {

class Reader {  // of msgpack
 public:
  explicit Reader(const std::string& bytes) : bytes_(bytes) {}

  Value value() {
    const auto tag = byte();
    Value out;
    if (tag < 0x80) return integer(tag);
    if (tag >= 0xe0) return integer(static_cast<std::int8_t>(tag));
    if (tag < 0x90) return map(tag & 0x0f);
    if (tag < 0xa0) return list(tag & 0x0f);
    if (tag < 0xc0) return text(tag & 0x1f);
    switch (tag) {
      case 0xc0: return out;
      case 0xc2: case 0xc3: out = integer(tag & 1); out.kind = Value::Kind::boolean; return out;
      case 0xc4: case 0xd9: return text(number<std::uint8_t>());
      case 0xc5: case 0xda: return text(number<std::uint16_t>());
      case 0xc6: case 0xdb: return text(number<std::uint32_t>());
      case 0xca: return real(number<float, std::uint32_t>());
      case 0xcb: return real(number<double, std::uint64_t>());
      case 0xcc: return integer(number<std::uint8_t>());
      case 0xcd: return integer(number<std::uint16_t>());
      case 0xce: return integer(number<std::uint32_t>());
      case 0xcf: return integer(static_cast<std::int64_t>(number<std::uint64_t>()));
      case 0xd0: return integer(number<std::int8_t, std::uint8_t>());
      case 0xd1: return integer(number<std::int16_t, std::uint16_t>());
      case 0xd2: return integer(number<std::int32_t, std::uint32_t>());
      case 0xd3: return integer(number<std::int64_t, std::uint64_t>());
      case 0xdc: return list(number<std::uint16_t>());
      case 0xdd: return list(number<std::uint32_t>());
      case 0xde: return map(number<std::uint16_t>());
      case 0xdf: return map(number<std::uint32_t>());
      default: throw std::runtime_error("a message holds what resim never sends");
    }
  }

 private:
  std::uint8_t byte() {
    if (at_ >= bytes_.size()) throw std::runtime_error("a message ends early");
    return static_cast<std::uint8_t>(bytes_[at_++]);
  }
  template <typename T, typename Raw = T>
  T number() {
    Raw raw = 0;
    for (std::size_t k = 0; k < sizeof(Raw); ++k) raw = static_cast<Raw>((static_cast<std::uint64_t>(raw) << 8) | byte());
    T out;
    std::memcpy(&out, &raw, sizeof(T));
    return out;
  }
  static Value integer(std::int64_t number) { Value out; out.kind = Value::Kind::integer; out.integer = number; return out; }
  static Value real(double number) { Value out; out.kind = Value::Kind::real; out.real = number; return out; }
  Value text(std::size_t size) {
    if (bytes_.size() - at_ < size) throw std::runtime_error("a message ends early");
    Value out;
    out.kind = Value::Kind::text;
    out.text = bytes_.substr(at_, size);
    at_ += size;
    return out;
  }
  Value list(std::size_t size) {
    Value out;
    out.kind = Value::Kind::list;
    while (size--) out.list.push_back(value());
    return out;
  }
  Value map(std::size_t size) {
    Value out;
    out.kind = Value::Kind::map;
    while (size--) { auto name = value().text; out.map[std::move(name)] = value(); }
    return out;
  }

  const std::string& bytes_;
  std::size_t at_ = 0;
};

class Writer {
 public:
  std::string bytes;

  void size(std::uint8_t tag, std::uint32_t count) { bytes.push_back(static_cast<char>(tag)); big(count, 4); }
  void map(std::uint32_t count) { size(0xdf, count); }
  void list(std::uint32_t count) { size(0xdd, count); }
  void nil() { bytes.push_back(static_cast<char>(0xc0)); }
  void integer(std::uint8_t number) { bytes.push_back(static_cast<char>(number)); }  // below 128
  void text(const std::string& text) { size(0xdb, static_cast<std::uint32_t>(text.size())); bytes += text; }
  void real(double number) {
    std::uint64_t raw;
    std::memcpy(&raw, &number, sizeof raw);
    bytes.push_back(static_cast<char>(0xcb));
    big(raw, 8);
  }

 private:
  void big(std::uint64_t number, int count) {
    while (count--) bytes.push_back(static_cast<char>(number >> (8 * count) & 0xff));
  }
};

inline bool read_all(int from, char* to, std::size_t size) {
  while (size > 0) {
    const auto got = ::read(from, to, size);
    if (got <= 0) return false;
    to += got;
    size -= static_cast<std::size_t>(got);
  }
  return true;
}

inline void write_all(int to, const char* from, std::size_t size) {
  while (size > 0) {
    const auto done = ::write(to, from, size);
    if (done <= 0) throw std::runtime_error("nobody reads the answers");
    from += done;
    size -= static_cast<std::size_t>(done);
  }
}

inline EgoState ego(const Value& told) {
  const auto& v = told.list;
  if (v.size() != 6) throw std::runtime_error("expected six numbers of the EGO");
  return {v[0].number(), v[1].number(), v[2].number(), v[3].number(), v[4].number(), v[5].number()};
}

inline std::vector<Point> points(const std::string& raw) {  // doubles, little endian as this machine
  std::vector<Point> out(raw.size() / sizeof(Point));
  if (!out.empty()) std::memcpy(out.data(), raw.data(), out.size() * sizeof(Point));
  return out;
}

inline Setup setup(const Value& told) {
  Setup out;
  out.parameters = told.at("parameters");
  out.map = told.at("road").at("file").text;
  for (const auto& one : Reader(told.at("road").at("lanes").text).value().list) {
    Lane lane;
    lane.road = one.at("road").text;
    lane.type = one.at("type").text;
    lane.section = static_cast<int>(one.at("section").integer);
    lane.lane = static_cast<int>(one.at("lane").integer);
    lane.centre = points(one.at("centre").text);
    lane.left = points(one.at("left").text);
    lane.right = points(one.at("right").text);
    for (const auto& number : one.at("after").list) lane.after.push_back(static_cast<int>(number.integer));
    out.lanes.push_back(std::move(lane));
  }
  out.start = ego(told.at("start"));
  out.goal = {told.at("goal").list.at(0).number(), told.at("goal").list.at(1).number()};
  out.length = told.at("length").number();
  out.width = told.at("width").number();
  out.cycle = told.at("cycle").number();
  out.seed = told.at("seed").integer;
  for (const auto& step : told.at("route").list) {
    out.route.emplace_back();
    for (const auto& road : step.list) out.route.back().push_back(road.text);
  }
  return out;
}

inline Perceived perceived(const Value& told) {
  Perceived out;
  out.t = told.at("t").number();
  out.ego = ego(told.at("ego"));
  const auto& columns = told.at("objects");
  const auto count = columns.at("id").list.size();
  const auto column = [&](const char* name) -> const std::vector<Value>& { return columns.at(name).list; };
  for (std::size_t k = 0; k < count; ++k)
    out.objects.push_back({column("id").at(k).text, column("kind").at(k).text, column("x").at(k).number(),
                           column("y").at(k).number(), column("heading").at(k).number(), column("v").at(k).number(),
                           column("length").at(k).number(), column("width").at(k).number(), column("z").at(k).number()});
  return out;
}

inline void answer(Writer& out, const Command& command) {
  out.map(3);
  out.text("acceleration");
  out.real(command.acceleration);
  out.text("curvature");
  out.real(command.curvature);
  out.text("plan");
  if (command.plan.empty()) {
    out.nil();
  } else {
    out.list(static_cast<std::uint32_t>(command.plan.size()));
    for (const auto& row : command.plan) {
      out.list(4);
      for (const double number : row) out.real(number);
    }
  }
}

}  // namespace detail

// Answers resim on the standard streams until the run ends; gives what main is to return.
inline int serve(Function& function) {
  const int answers = ::dup(1);
  ::dup2(2, 1);  // what the function prints is no answer
  for (;;) {
    unsigned char head[4];
    if (!detail::read_all(0, reinterpret_cast<char*>(head), 4)) return 0;
    const std::size_t size = head[0] | head[1] << 8 | head[2] << 16 | static_cast<std::size_t>(head[3]) << 24;
    std::string bytes(size, '\0');
    if (!detail::read_all(0, bytes.data(), size)) return 1;
    detail::Writer out;
    try {
      const auto message = detail::Reader(bytes).value();
      const auto& kind = message.at("message").text;
      if (kind == "step") {
        detail::answer(out, function.step(detail::perceived(message)));
      } else if (kind == "reset") {
        if (message.at("protocol").integer != PROTOCOL) throw std::runtime_error("resim speaks another version");
        function.reset(detail::setup(message));
        out.map(1);
        out.text("protocol");
        out.integer(PROTOCOL);
      } else if (kind == "close") {
        function.close();
        return 0;
      } else {
        throw std::runtime_error("there is no message " + kind);
      }
    } catch (const std::exception& e) {
      out = detail::Writer();
      out.map(1);
      out.text("error");
      out.text(e.what());
    }
    const auto length = out.bytes.size();
    std::string whole{static_cast<char>(length & 0xff), static_cast<char>(length >> 8 & 0xff),
                      static_cast<char>(length >> 16 & 0xff), static_cast<char>(length >> 24 & 0xff)};
    whole += out.bytes;
    detail::write_all(answers, whole.data(), whole.size());
  }
}

}  // namespace resim
