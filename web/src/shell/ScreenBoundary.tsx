import { Component, type ReactNode } from "react";
import { Icon } from "../design/Icon";
import { words } from "../text/words";

interface ScreenBoundaryProps {
  readonly children: ReactNode;
}

/** Keeps a screen that breaks from taking the stops above it along. */
export class ScreenBoundary extends Component<ScreenBoundaryProps, { readonly reason: string | null }> {
  override readonly state: { readonly reason: string | null } = { reason: null };

  static getDerivedStateFromError(error: unknown): { readonly reason: string } {
    return { reason: error instanceof Error ? error.message : String(error) };
  }

  override render(): ReactNode {
    const { reason } = this.state;
    if (reason === null) return this.props.children;
    return (
      <div className="screen-broken" role="alert">
        <Icon name="error" />
        <strong>{words.screens.broken}</strong>
        <span>{words.screens.brokenDo}</span>
        <code>{reason}</code>
        <button
          type="button"
          className="button"
          onClick={() => {
            this.setState({ reason: null });
          }}
        >
          <Icon name="rearm" />
          {words.screens.brokenAgain}
        </button>
      </div>
    );
  }
}
