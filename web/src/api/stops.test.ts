import { describe, expect, it, vi } from "vitest";
import { problemText, RequestError, type request } from "./request";
import { stopFleet } from "./stops";

const noPause = () => Promise.resolve();

describe("stopFleet", () => {
  it("is sent once when it is accepted", async () => {
    const send = vi.fn<typeof request>().mockResolvedValue(undefined);
    await stopFleet("cut_motors", send, noPause);
    expect(send.mock.calls.map((call) => call.slice(0, 2))).toEqual([["POST", "/fleet/cut-motors"]]);
  });

  it("is sent again until it is accepted", async () => {
    const send = vi
      .fn<typeof request>()
      .mockRejectedValueOnce(new RequestError("no answer", null))
      .mockRejectedValueOnce(new RequestError("refused", 503))
      .mockResolvedValue(undefined);
    await stopFleet("hold", send, noPause);
    expect(send).toHaveBeenCalledTimes(3);
  });

  it("fails loudly with the last reason after three attempts", async () => {
    const send = vi
      .fn<typeof request>()
      .mockRejectedValueOnce(new RequestError("first", null))
      .mockRejectedValueOnce(new RequestError("second", null))
      .mockRejectedValue(new RequestError("third", 500));
    await expect(stopFleet("land", send, noPause)).rejects.toThrow("third");
    expect(send).toHaveBeenCalledTimes(3);
  });
});

describe("problemText", () => {
  it("joins detail and field errors, without the phrase of the status", () => {
    const problem = {
      title: "Unprocessable Content",
      detail: "2 errors",
      errors: [{ loc: ["body", "pictures"], msg: "too small" }, "and more"],
    };
    expect(problemText(problem)).toBe("2 errors — pictures: too small — and more");
  });

  it.each([null, 3, "text", {}, { title: "Conflict" }, { detail: 4 }])("knows that %j tells no problem", (value) => {
    expect(problemText(value)).toBeNull();
  });
});
