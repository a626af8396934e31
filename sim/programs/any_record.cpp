#include "any_record.hpp"

#include "../models/registry.hpp"

namespace saltus::program {

Record record_of_log(const LoggedRun& run, std::string_view model) {
  std::vector<Channel> inputs, outputs;
  const auto name_by = [&](std::string_view wanted) {
    const auto take = [&](auto m) {
      using M = decltype(m);
      if (M::name != wanted || !outputs.empty()) return;
      for (const Quantity& q : M::inputs) inputs.push_back({std::string(q.name), std::string(q.unit), {}});
      for (const Quantity& q : M::outputs) outputs.push_back({std::string(q.name), std::string(q.unit), {}});
    };
    visit_each(KnownModels{}, take);
    visit_each(MachineModels{}, take);
  };
  name_by(model);
  name_by((run.experimenter.id != 0 ? run.experimenter : run.machine).model.view());
  return record_of(run, inputs, outputs);
}

Record read_any_record(const std::string& file, std::string_view model) {
  return is_event_log(file) ? record_of_log(LoggedRun(file), model) : read_record(std::filesystem::path(file));
}

}  // namespace saltus::program
