// A gyro driver in C++: a gyro that resolves only 2 deg/s. It is ../../gyro_driver.py in C++.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "diagnostic_msgs/msg/key_value.hpp"
#include "rclcpp/rclcpp.hpp"
#include "sensor_msgs/msg/imu.hpp"
#include "std_msgs/msg/header.hpp"

using diagnostic_msgs::msg::DiagnosticStatus;
using diagnostic_msgs::msg::KeyValue;
using sensor_msgs::msg::Imu;
using std_msgs::msg::Header;

namespace
{

constexpr double kAtRest = 600.0;  // [deg/s]
constexpr double kResolution = 2.0;  // [deg/s]
constexpr double kDegreesPerRadian = 180.0 / M_PI;

// The stamp of a header [ns].
int64_t time_ns(const Header & header)
{
  return header.stamp.sec * int64_t{1'000'000'000} + header.stamp.nanosec;
}

// What the gyro reads [rad/s] at a true rate [rad/s].
double reading(double rate)
{
  const double counts = std::nearbyint(rate * kDegreesPerRadian / kResolution);
  return (kAtRest + kResolution * counts) / kDegreesPerRadian;
}

std::string host()
{
  char name[256] = {};
  gethostname(name, sizeof(name) - 1);
  return name;
}

// Answers each true rate of the body with one reading of the same stamp.
class GyroDriver : public rclcpp::Node
{
public:
  GyroDriver()
  : Node("gyro_driver"), instance_(std::to_string(std::random_device{}()))
  {
    const auto stream = rclcpp::QoS(128);  // reliable and volatile, the defaults
    const auto state = rclcpp::QoS(1).transient_local();
    participants_ = create_publisher<DiagnosticStatus>("participants", state);
    gyro_ = create_publisher<Imu>("gyro", stream);
    roll_calls_ = create_subscription<Header>(
      "plant/roll_call", state, [this](const Header & call) {on_roll_call(call);});
    truths_ = create_subscription<Imu>(
      "plant/imu", stream, [this](const Imu & truth) {on_truth(truth);});
  }

private:
  // Join the run if it is new; announce this node in any case.
  void on_roll_call(const Header & call)
  {
    if (call.frame_id != run_) {
      run_ = call.frame_id;
      start_ns_ = time_ns(call);
      answered_ns_ = 0;
    }
    const std::vector<std::pair<std::string, std::string>> values = {
      {"role", "gyro_driver"},
      {"process", std::to_string(getpid())},
      {"instance", instance_},
      {"run", run_},
      {"implementation", "my gyro in C++ 1.0"},
      {"parameters sha256", ""},
      {"topics", "gyro"},
      {"answered [ns]", std::to_string(answered_ns_)},
    };
    DiagnosticStatus announcement;
    announcement.name = get_fully_qualified_name();
    announcement.hardware_id = host();
    for (const auto & [key, value] : values) {
      KeyValue pair;
      pair.key = key;
      pair.value = value;
      announcement.values.push_back(pair);
    }
    participants_->publish(announcement);
  }

  // Answer a truth of the run; one that comes again gets the same answer.
  void on_truth(const Imu & truth)
  {
    const int64_t now_ns = time_ns(truth.header);
    if (now_ns < start_ns_) {
      return;
    }
    Imu sample;
    sample.header = truth.header;
    sample.angular_velocity.x = reading(truth.angular_velocity.x);
    sample.angular_velocity.y = reading(truth.angular_velocity.y);
    gyro_->publish(sample);
    answered_ns_ = std::max(answered_ns_, now_ns);
  }

  std::string instance_;
  std::string run_;
  int64_t start_ns_ = std::numeric_limits<int64_t>::max();
  int64_t answered_ns_ = 0;
  rclcpp::Publisher<DiagnosticStatus>::SharedPtr participants_;
  rclcpp::Publisher<Imu>::SharedPtr gyro_;
  rclcpp::Subscription<Header>::SharedPtr roll_calls_;
  rclcpp::Subscription<Imu>::SharedPtr truths_;
};

}  // namespace

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<GyroDriver>());
  rclcpp::shutdown();
  return 0;
}
